//! Every instruction set against the one-lane twin, and the twin against the standard library.

use super::*;

/// Every operation on one lane vector.
struct Everything {
    a: Lane,
    b: Lane,
}

impl Work for Everything {
    type Output = Vec<Lane>;

    #[inline(always)]
    fn run<V: Vector>(self) -> Vec<Lane> {
        let mut out = vec![[0.0; LANES]; 14];
        for part in 0..LANES / V::WIDTH {
            let (a, b) = (V::load(&self.a, part), V::load(&self.b, part));
            let positive = a * a + V::splat(1.0);
            let (exponent, mantissa) = positive.split();
            let results = [
                a + b,
                a - b,
                a * b,
                a / b,
                -a,
                a.mul_add(b, b),
                positive.sqrt(),
                a.if_greater(b, a, V::splat(2.0)),
                (a * b).round(),
                a.round().power_of_two(),
                exponent,
                mantissa,
                (-positive).exp(),
                positive.ln(),
            ];
            for (slot, value) in out.iter_mut().zip(results) {
                value.store(slot, part);
            }
        }
        out
    }
}

#[test]
fn every_instruction_set_gives_the_bits_of_one_lane() {
    for seed in 0..200_u32 {
        let value = |i: usize, k: u32| ((seed * 16 + i as u32) as f32 * 0.377 + k as f32).sin() * 9.0;
        let a: Lane = std::array::from_fn(|i| value(i, 0));
        let b: Lane = std::array::from_fn(|i| value(i, 1));
        let scalar = Level::Scalar.run(Everything { a, b });
        for level in Level::available() {
            let bits = |lanes: &[Lane]| lanes.iter().flatten().map(|v| v.to_bits()).collect::<Vec<u32>>();
            assert_eq!(bits(&scalar), bits(&level.run(Everything { a, b })), "{level:?}");
        }
    }
}

#[test]
fn exp_and_ln_are_as_exact_as_they_say() {
    let mut x = -90.0_f32;
    while x < 0.0 {
        let exact = f64::from(x).exp();
        let found = f64::from(Vector::exp(x));
        if x > -87.0 {
            assert!((found / exact - 1.0).abs() < 2e-7, "exp {x}: {found:e} for {exact:e}");
        } else {
            assert_eq!(found, 0.0);
        }
        x += 0.001_37;
    }
    let mut y = 1.0_f32;
    while y < 1e9 {
        let exact = f64::from(y).ln();
        assert!((f64::from(Vector::ln(y)) - exact).abs() < 3e-7 * exact.max(1.0), "ln {y}");
        y *= 1.000_37;
    }
    assert_eq!(Vector::exp(0.0_f32), 1.0);
    assert_eq!(Vector::ln(1.0_f32), 0.0);
}

/// What [`look_ups`](super::look_ups) says it does, one sample at a time.
fn looked_up(frames: &[Vec<u8>], rows: &[Vec<[f32; 6]>], values: &[[f32; 256]; 3], sample: usize) -> (f32, f32, bool) {
    let channel = sample % 3;
    let open = frames.iter().take_while(|frame| frame[sample] < 252).count();
    let level = |k: usize| if k < open { usize::from(frames[open - 1 - k][sample]) } else { 0 };
    let [first, weights @ .., variance] = rows[channel][256 * open + level(0)];
    let sum = (0..4).fold(first, |sum, k| sum + weights[k] * values[channel][level(1 + k)]);
    (sum, variance, open > 0 && level(0) >= 10)
}

#[test]
fn look_ups_side_by_side_give_the_bits_of_single_ones() {
    let mut state = 7_u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as u32
    };
    // Blocks, a last block of a few groups, and pixels that are no whole group.
    let pixels = 512 + 3 * 64 + 17;
    for count in [1, 2, 4, 7, 10, 30] {
        let frames: Vec<Vec<u8>> = (0..count).map(|_| (0..3 * pixels).map(|_| random() as u8).collect()).collect();
        let mut number = || random() as f32 / 1e5;
        let values: [[f32; 256]; 3] = std::array::from_fn(|_| std::array::from_fn(|_| number()));
        let upper = |value: f32| f32::from_bits(value.to_bits() & 0xffff_0000);
        let mut row = || [number(), upper(number()), upper(number()), upper(number()), upper(number()), number()];
        let rows: Vec<Vec<[f32; 6]>> = (0..3).map(|_| (0..256 * (count + 1)).map(|_| row()).collect()).collect();
        let channels = std::array::from_fn(|c| {
            let row = |&[first, a, b, c, d, variance]: &[f32; 6]| look_ups::Row::new(first, [a, b, c, d], variance);
            let rows = rows[c].as_chunks::<256>().0;
            look_ups::Channel::new(rows.iter().map(|level| level.each_ref().map(row)).collect(), &values[c])
        });
        let mut made = (vec![[0.0; 3]; pixels], vec![[0.0; 3]; pixels], vec![false; pixels]);
        let mut into = look_ups::Into { sums: &mut made.0, variances: &mut made.1, usable: &mut made.2 };
        let slices: Vec<&[u8]> = frames.iter().map(Vec::as_slice).collect();
        let levels = look_ups::Levels { limit: 252, lowest: 10 };
        for level in [Level::Scalar, Level::Avx2] {
            assert_eq!(look_ups::look_ups(level, &slices, levels, &channels, &mut into), 0, "{level:?}");
        }
        let short = vec![&frames[0][..3]; count];
        assert_eq!(look_ups::look_ups(Level::Avx512, &short, levels, &channels, &mut into), 0, "frames too short");
        let done = look_ups::look_ups(Level::Avx512, &slices, levels, &channels, &mut into);
        assert!(done == 0 || done == pixels / 64 * 64, "{done}");
        for pixel in 0..done {
            let all = [0, 1, 2].map(|c| looked_up(&frames, &rows, &values, 3 * pixel + c));
            assert_eq!(made.2[pixel], all.iter().all(|one| one.2), "{count} frames, pixel {pixel}");
            for (c, (sum, variance, _)) in all.into_iter().enumerate() {
                let bits = [made.0[pixel][c], made.1[pixel][c]].map(f32::to_bits);
                assert_eq!(bits, [sum.to_bits(), variance.to_bits()], "{count} frames, pixel {pixel}, channel {c}");
            }
        }
    }
}
