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
