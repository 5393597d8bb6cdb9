//! Few seeds of the study of accuracy, on small scenes.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use rigd::study::accuracy::measure;
use rigd::study::scene::Scene;

/// The search ends where it ends from the truth; errors stay small. Coverage falls short (docs/study.md): the study measures it.
#[test]
fn small_scenes_reach_the_optimum() {
    let scene = Scene { points: 1500, ..Scene::marble() };
    let all: Vec<_> = (0..4).map(|seed| measure(&scene, seed).unwrap()).collect();
    assert!(all.iter().all(|one| one.excess <= 1e-8));
    assert!(all.iter().all(|one| one.relight < 0.01 && one.beta < 0.02));
}
