//! What a JPEG says of a pixel before its decoder rounds, against pictures whose levels are known and against the rounding decoder.
#![allow(clippy::unwrap_used)]

use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rigd::pipeline::decode::decode;
use rigd::pipeline::fine::{Unread, fine_levels};

const SIZE: (usize, usize) = (331, 173);

fn encoded(sampling: SamplingFactor, restart: u16, pixel: &mut dyn FnMut(usize, usize) -> [u8; 3]) -> Vec<u8> {
    let pixels: Vec<u8> = (0..SIZE.0 * SIZE.1).flat_map(|i| pixel(i % SIZE.0, i / SIZE.0)).collect();
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, 99);
    encoder.set_sampling_factor(sampling);
    if restart > 0 {
        encoder.set_restart_interval(restart);
    }
    encoder.encode(&pixels, SIZE.0 as u16, SIZE.1 as u16, ColorType::Rgb).unwrap();
    bytes
}

fn all() -> Vec<(usize, usize)> {
    (0..SIZE.0 * SIZE.1).map(|i| (i % SIZE.0, i / SIZE.0)).collect()
}

/// Smooth waves of every colour, inside the levels.
fn waves(x: usize, y: usize) -> [u8; 3] {
    let wave = |a: f64, b: f64, c: f64| (120.0 + 80.0 * (x as f64 / a + y as f64 / b + c).sin()).round() as u8;
    [wave(19.0, 31.0, 0.0), wave(-27.0, 17.0, 1.0), wave(41.0, -23.0, 2.0)]
}

#[test]
fn it_agrees_with_the_rounding_decoder_within_its_rounding() {
    // Rounded on the way: luminance, a difference of colour (times 1.772 in blue) and the level, half a level each, and the decoder's
    // transform is in whole numbers.
    let rounding = 0.5 + 0.5 * 1.772 + 0.5 + 0.05;
    for (sampling, most) in
        [(SamplingFactor::F_1_1, rounding), (SamplingFactor::F_2_1, 12.0), (SamplingFactor::F_2_2, 20.0)]
    {
        for restart in [0, 5] {
            let bytes = encoded(sampling, restart, &mut waves);
            let (fine, rounded) = (fine_levels(&bytes, &all()).unwrap(), decode(&bytes).unwrap());
            let off = |(fine, rounded): (&[f32; 3], &[u8; 3])| {
                (0..3).map(|c| (fine[c] - f32::from(rounded[c])).abs()).fold(0.0, f32::max)
            };
            let worst = fine.iter().zip(&rounded.pixels).map(off).fold(0.0, f32::max);
            // Coarser differences of colour are spread differently over their pixels.
            assert!(worst < most, "{sampling:?}, restart {restart}: {worst}");
        }
    }
}

/// An even, slightly noisy surface of one hue: the rounding decoder is wrong by up to half a level in all of it.
#[test]
fn it_keeps_the_mean_of_an_even_surface() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(7);
    let (mut worst_fine, mut worst_rounded) = (0.0_f64, 0.0_f64);
    for step in 0..12 {
        let base = [1.2, 1.0, 0.85].map(|part| part * (15.0 + 3.7 * f64::from(step)));
        let mut sum = [0.0; 3];
        let bytes = encoded(SamplingFactor::F_1_1, 0, &mut |_, _| {
            let level: [u8; 3] = base.map(|b| (b + 0.8 * random.sample::<f64, _>(StandardNormal)).round() as u8);
            sum = std::array::from_fn(|c| sum[c] + f64::from(level[c]));
            level
        });
        let count = (SIZE.0 * SIZE.1) as f64;
        let (fine, rounded) = (fine_levels(&bytes, &all()).unwrap(), decode(&bytes).unwrap());
        for c in 0..3 {
            let of_fine = fine.iter().map(|p| f64::from(p[c])).sum::<f64>();
            let of_rounded = rounded.pixels.iter().map(|p| f64::from(p[c])).sum::<f64>();
            worst_fine = worst_fine.max((of_fine - sum[c]).abs() / count);
            worst_rounded = worst_rounded.max((of_rounded - sum[c]).abs() / count);
        }
    }
    // What is left is the encoder's: it rounds differences of colour to whole levels, halves down.
    assert!(worst_fine < 0.2 && worst_rounded > 2.0 * worst_fine, "{worst_fine} against {worst_rounded}");
}

#[test]
fn other_and_damaged_files_are_left_to_the_decoder() {
    let bytes = encoded(SamplingFactor::F_1_1, 0, &mut waves);
    for cut in [0, 1, 2, 3, 20, 200, bytes.len() / 2, bytes.len() - 100] {
        assert!(fine_levels(&bytes[..cut], &all()).is_err(), "{cut}");
    }
    assert_eq!(fine_levels(&bytes, &[(SIZE.0, 0)]), Err(Unread::Unsuited));
    assert_eq!(fine_levels(b"\x89PNG\r\n\x1a\n", &[(0, 0)]), Err(Unread::Unsuited));
    let half_with_an_end = [&bytes[..3 * bytes.len() / 4], b"\xff\xd9"].concat();
    assert_eq!(fine_levels(&half_with_an_end, &[]), Err(Unread::Damaged));
    let mut random = Xoshiro256PlusPlus::seed_from_u64(8);
    for _ in 0..2000 {
        let mut broken = bytes.clone();
        for _ in 0..random.random_range(1..5) {
            let at = random.random_range(0..700);
            broken[at] = random.random();
        }
        // Any answer, but no panic.
        let _ = fine_levels(&broken, &[(0, 0), (SIZE.0 - 1, SIZE.1 - 1)]);
    }
}
