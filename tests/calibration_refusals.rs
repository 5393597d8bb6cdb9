//! What an operator, a camera or a lamp does wrong in a calibration: every fault is named with what to do, the run asks again for the same
//! step, and with everything put right it completes.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod stage;

use rigd::devices::camera::RawFrame;
use rigd::numerics::image::Image;
use rigd::session::handle::{CalibrationRequest, EngineHandle, Step};
use rigd::session::state::{SessionState as S, Verb};
use rigd::sim::stage::{Placed, Print, StageHandle};
use rigd::sim::world::World;
use stage::{Spoil, placed, spoiled_engine, text, turn};

struct Run {
    engine: EngineHandle,
    id: String,
    stage: StageHandle,
    spoil: Spoil,
}

impl Run {
    /// Shoots the step in hand as it is placed; whether it was accepted, and else why not.
    fn shoot(&self) -> Result<(), String> {
        let before = turn(&self.engine, &self.id);
        self.engine.command_calibration(&self.id, Verb::Shoot).unwrap();
        let after = stage::until("the verdict", || {
            let now = turn(&self.engine, &self.id);
            (now.verdicts.len() > before.verdicts.len()).then_some(now)
        });
        let last = after.verdicts.last().unwrap();
        assert_eq!(last.step, before.step);
        if last.accepted {
            return Ok(());
        }
        assert_eq!((after.state, after.step), (S::Awaiting, before.step), "{:?}", after.reason);
        Err(last.reason.clone().unwrap())
    }

    /// The frames as `spoil` leaves them must be refused for a reason that names all of `words`.
    fn refused(&self, what: &str, words: &[&str]) {
        let reason = self.shoot().expect_err(what);
        println!("{what}: {reason}");
        for word in words {
            assert!(reason.contains(word), "{what}: {word} is missing in: {reason}");
        }
        self.spoil.nothing();
    }

    fn accepted(&self) {
        self.stage.place(placed(turn(&self.engine, &self.id).step));
        self.shoot().unwrap();
    }
}

/// Every level times `factor`.
fn brighter(picture: &mut Image<[u8; 3]>, factor: f64) {
    picture.pixels.iter_mut().flatten().for_each(|level| *level = (f64::from(*level) * factor) as u8);
}

/// All of it that many pixels further right and down.
fn moved(picture: &mut Image<[u8; 3]>, by: (usize, usize)) {
    let old = picture.clone();
    for y in 0..old.height {
        for x in 0..old.width {
            picture.pixels[y * old.width + x] =
                if x >= by.0 && y >= by.1 { *old.at(x - by.0, y - by.1) } else { [0; 3] };
        }
    }
}

/// Mean over a square of that many pixels to each side.
fn blurred(picture: &mut Image<[u8; 3]>, half: usize) {
    for rows in [false, true] {
        let old = picture.clone();
        let (width, height) = (old.width, old.height);
        for y in 0..height {
            for x in 0..width {
                let (at, size) = if rows { (y, height) } else { (x, width) };
                let range = at.saturating_sub(half)..(at + half + 1).min(size);
                let count = range.len() as u32;
                let mut sum = [0_u32; 3];
                for i in range {
                    let pixel = if rows { old.at(x, i) } else { old.at(i, y) };
                    (0..3).for_each(|c| sum[c] += u32::from(pixel[c]));
                }
                picture.pixels[y * width + x] = sum.map(|sum| (sum / count) as u8);
            }
        }
    }
}

/// Column of the middle of the board or card.
fn middle_x(world: &World, print: Print, view: usize) -> f64 {
    world.flat(print, view).outline().iter().map(|at| world.truth().projection.project(at)[0]).sum::<f64>() / 4.0
}

/// A file without its APP1 segments.
fn without_exif(bytes: &[u8]) -> Vec<u8> {
    let (mut out, mut at) = (bytes[..2].to_vec(), 2);
    while bytes[at + 1] != 0xda {
        let length = 2 + usize::from(u16::from_be_bytes([bytes[at + 2], bytes[at + 3]]));
        if bytes[at + 1] != 0xe1 {
            out.extend(&bytes[at..at + length]);
        }
        at += length;
    }
    out.extend(&bytes[at..]);
    out
}

fn begin(data: &std::path::Path) -> (Run, rig_config::Rig, World) {
    let (stage, spoil) = (StageHandle::default(), Spoil::default());
    let (rig, engine) = spoiled_engine(&text(), data, &stage, &spoil);
    let world = World::new(&rig, rig.simulation.as_ref().unwrap());
    let id = engine.start_calibration(&CalibrationRequest::default()).unwrap().id;
    let run = Run { engine, id, stage, spoil };
    assert_eq!(turn(&run.engine, &run.id).step, Step::Board { view: 1, of: 8 });
    (run, rig, world)
}

#[test]
fn faults_of_frames_board_and_card_are_named_and_asked_again() {
    let data = tempfile::tempdir().unwrap();
    let (run, rig, world) = begin(data.path());

    // Frames.
    run.stage.place(Placed::Board { view: 0 });
    run.spoil.frames(|_, frame| RawFrame { bytes: without_exif(&frame.bytes), ..frame });
    run.refused("no EXIF", &["refused 3 times", "no readable EXIF", "let the camera write EXIF"]);
    run.spoil.frames(|_, frame| RawFrame { bytes: frame.bytes[..frame.bytes.len() / 2].to_vec(), ..frame });
    run.refused("cut off", &["refused 3 times", "cut off", "check cable and card"]);
    let mut first = None;
    run.spoil.frames(move |_, frame| first.get_or_insert(frame).clone());
    // The first of them is a frame of its own: it is taken, and every later one is it again.
    run.shoot().unwrap();
    run.refused("repeated", &["refused 3 times", "byte for byte", "switch the camera off and on"]);
    run.spoil.pictures(|_, picture| *picture = Image::filled(64, 48, [90; 3]));
    run.refused("another size", &["64 x 48 pixels", "set the image size"]);

    // The board; view 1 was taken above.
    run.stage.place(Placed::Board { view: 1 });
    run.spoil.pictures(|_, picture| brighter(picture, 0.0));
    run.refused("lamp dark", &["no board found", "expose more"]);
    run.spoil.pictures(|_, picture| blurred(picture, 12));
    run.refused("out of focus", &["blurred", "focus"]);
    let half_out = rig.camera.width - middle_x(&world, Print::Chessboard, 1) as usize;
    run.spoil.pictures(move |_, picture| moved(picture, (half_out, 0)));
    run.refused("partly out of view", &["partly out of view", "show all of it"]);
    run.spoil.pictures(|_, picture| brighter(picture, 3.0));
    run.refused("clipped to white", &["white squares are clipped", "away from the lamp", "board_exposure"]);
    for _ in 2..=8 {
        run.accepted();
    }

    // The card.
    assert_eq!(turn(&run.engine, &run.id).step, Step::Card);
    run.stage.place(Placed::Card { on: 7 });
    run.spoil.pictures(|_, picture| brighter(picture, 0.0));
    run.refused("card dark", &["black", "switch the lamp on"]);
    run.stage.place(Placed::Board { view: 7 });
    run.refused("no card on the board", &["darker than the rest"]);
    run.stage.place(Placed::Card { on: 7 });
    let middle = middle_x(&world, Print::Grey, 7);
    // A quarter of the light is missing on the left; what is clipped stays so.
    let dimmed = world.truth().tones.map(|tone| -> [u8; 256] {
        std::array::from_fn(|z| if z < 250 { tone.level(0.75 * tone.charge(z as f64)).round() as u8 } else { 255 })
    });
    run.spoil.pictures(move |_, picture| {
        let width = picture.width;
        let left = picture.pixels.iter_mut().enumerate().filter(|(i, _)| ((i % width) as f64) < middle);
        left.for_each(|(_, pixel)| *pixel = std::array::from_fn(|c| dimmed[c][usize::from(pixel[c])]));
    });
    run.refused("card in shadow", &["darker than the rest", "out of the shadow"]);
    // A push of less than what the card has to spare nobody can see.
    run.spoil.pictures(|_, picture| moved(picture, (500, 0)));
    run.refused("camera pushed since the board", &["% of the card's pixels", "outside the frame"]);
    run.accepted();
    run.engine.shutdown().unwrap();
}

#[test]
fn faults_of_balls_are_named_and_asked_again_until_the_run_completes() {
    let data = tempfile::tempdir().unwrap();
    let (run, _, world) = begin(data.path());
    (1..=9).for_each(|_| run.accepted());
    assert_eq!(turn(&run.engine, &run.id).step, Step::Balls);
    run.stage.place(Placed::Balls);
    run.spoil.pictures(|shot, picture| {
        if shot.exposure == 0 || shot.exposure == 1 {
            brighter(picture, 0.0);
        }
    });
    run.refused("highlights missing", &["highlight"]);
    run.spoil.pictures(|shot, picture| {
        if shot.station % 3 == 0 {
            moved(picture, (5, 0));
        }
    });
    run.refused("camera pushed between two stations", &["camera or stage moved", "shoot the balls again"]);
    let ball = world.truth().projection.project(&world.balls().spheres()[0].center);
    run.spoil.pictures(move |_, picture| {
        let width = picture.width;
        let on_ball = |i: usize| ((i % width) as f64 - ball[0]).hypot((i / width) as f64 - ball[1]) < 130.0;
        picture.pixels.iter_mut().enumerate().filter(|(i, _)| on_ball(*i)).for_each(|(_, pixel)| *pixel = [0; 3]);
    });
    run.refused("two balls of three", &["2 of 3 balls found", "put up all of them"]);
    run.spoil.pictures(|_, picture| {
        let shines = |pixel: &&mut [u8; 3]| pixel.iter().any(|level| *level > 60);
        picture.pixels.iter_mut().filter(shines).for_each(|pixel| *pixel = [255; 3]);
    });
    run.refused("highlights clipped", &["is clipped", "in the shortest exposure too", "calibration.exposures"]);
    run.accepted();

    let end =
        stage::until("the end", || Some(run.engine.calibration(&run.id).unwrap()).filter(|now| now.state.is_final()));
    assert_eq!(end.state, S::Completed, "{:?}", end.reason);
    assert!(run.engine.calibration_result(&run.id).unwrap().is_some());
}
