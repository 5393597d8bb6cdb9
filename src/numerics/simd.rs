//! Vectors of f32 for the fit's inner loops, with the instruction set chosen at run time: AVX-512, AVX2 with FMA, or one
//! lane at a time. This is the one module with `unsafe`.
//!
//! Every instruction used is correctly rounded (fused multiply-add included) and lanes never mix, so that all three give the
//! same bits: the one-lane version is the twin the others are tested against.
#![allow(unsafe_code)]

use std::ops::{Add, Div, Mul, Neg, Sub};

/// Points side by side in memory: the width of the widest instruction set.
pub const LANES: usize = 16;

/// One value for each of the points side by side.
pub type Lane = [f32; LANES];

/// A vector of some of the [`LANES`].
pub trait Vector:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// Lanes in a vector; divides [`LANES`].
    const WIDTH: usize;
    /// The same value in every lane.
    fn splat(value: f32) -> Self;
    /// Lanes `part * WIDTH` onwards.
    fn load(from: &Lane, part: usize) -> Self;
    /// Writes lanes `part * WIDTH` onwards.
    fn store(self, to: &mut Lane, part: usize);
    /// `self * factor + term`, rounded once.
    fn mul_add(self, factor: Self, term: Self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// `if self > other { yes } else { no }`, lane by lane; false for NaN.
    fn if_greater(self, other: Self, yes: Self, no: Self) -> Self;
    /// The nearest whole number, ties to even.
    fn round(self) -> Self;
    /// 2 to the power of a whole number from -126 to 127.
    fn power_of_two(self) -> Self;
    /// Exponent and mantissa (from 1 to below 2) of a positive normal number.
    fn split(self) -> (Self, Self);

    /// The greater of two; `other` where `self` is NaN.
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.if_greater(other, self, other)
    }

    /// e to the power of `self`, for `self <= 0`; 0 below -87. Relative error below 2e-7.
    #[inline(always)]
    fn exp(self) -> Self {
        let floor = Self::splat(-87.0);
        let x = self.max(floor);
        let n = (x * Self::splat(std::f32::consts::LOG2_E)).round();
        // ln 2 in two parts, so that x - n ln 2 keeps its digits (Cody and Waite 1980).
        let r = n.mul_add(Self::splat(-0.693_359_4), x);
        let r = n.mul_add(Self::splat(2.121_944_4e-4), r);
        let mut p = Self::splat(1.987_569_1e-4);
        for coefficient in [1.398_2e-3, 8.333_452e-3, 4.166_579_6e-2, 1.666_666_5e-1, 0.5, 1.0, 1.0] {
            p = p.mul_add(r, Self::splat(coefficient));
        }
        self.if_greater(floor, p * n.power_of_two(), Self::splat(0.0))
    }

    /// Natural logarithm of `self >= 1`. Absolute error below 3e-7 (relative for large values).
    #[inline(always)]
    fn ln(self) -> Self {
        let (exponent, mantissa) = self.split();
        // Mantissas above sqrt 2 are halved, so that the series runs over |s| < 0.172.
        let root2 = Self::splat(std::f32::consts::SQRT_2);
        let half = Self::splat(0.5);
        let one = Self::splat(1.0);
        let e = mantissa.if_greater(root2, exponent + one, exponent);
        let m = mantissa.if_greater(root2, mantissa * half, mantissa);
        // ln m = 2 artanh s with s = (m - 1) / (m + 1).
        let s = (m - one) / (m + one);
        let z = s * s;
        let mut p = Self::splat(2.0 / 9.0);
        for coefficient in [2.0 / 7.0, 2.0 / 5.0, 2.0 / 3.0, 2.0] {
            p = p.mul_add(z, Self::splat(coefficient));
        }
        e.mul_add(Self::splat(std::f32::consts::LN_2), p * s)
    }
}

/// Work written once for all instruction sets. `run` must be `#[inline(always)]`, or it is compiled without them.
pub trait Work {
    /// What it returns.
    type Output;
    /// Does it with vectors of type `V`.
    fn run<V: Vector>(self) -> Self::Output;
}

/// Instruction sets, narrowest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// One lane at a time, any processor.
    Scalar,
    /// AVX2 and FMA.
    Avx2,
    /// AVX-512 F.
    Avx512,
}

impl Level {
    /// Every level this processor has.
    pub fn available() -> Vec<Self> {
        #[allow(unused_mut)]
        let mut levels = vec![Self::Scalar];
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                levels.push(Self::Avx2);
            }
            if is_x86_feature_detected!("avx512f") {
                levels.push(Self::Avx512);
            }
        }
        levels
    }

    /// The widest level this processor has.
    pub fn best() -> Self {
        static BEST: std::sync::OnceLock<Level> = std::sync::OnceLock::new();
        *BEST.get_or_init(|| Self::available().last().copied().unwrap_or(Self::Scalar))
    }

    /// Runs `work` with this level, or with the widest one there is if the processor lacks it.
    pub fn run<W: Work>(self, work: W) -> W::Output {
        #[cfg(target_arch = "x86_64")]
        {
            let level = if (self as usize) > (Self::best() as usize) { Self::best() } else { self };
            match level {
                // SAFETY: a level above `Scalar` is at most `best()`, which the processor was asked for.
                Self::Avx512 => return unsafe { x86::avx512(work) },
                // SAFETY: as above; every processor with AVX-512 has AVX2 and FMA.
                Self::Avx2 => return unsafe { x86::avx2(work) },
                Self::Scalar => {}
            }
        }
        work.run::<f32>()
    }
}

impl Vector for f32 {
    const WIDTH: usize = 1;

    #[inline(always)]
    fn splat(value: f32) -> Self {
        value
    }

    #[inline(always)]
    fn load(from: &Lane, part: usize) -> Self {
        from[part % LANES]
    }

    #[inline(always)]
    fn store(self, to: &mut Lane, part: usize) {
        to[part % LANES] = self;
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        f32::mul_add(self, factor, term)
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        f32::sqrt(self)
    }

    #[inline(always)]
    fn if_greater(self, other: Self, yes: Self, no: Self) -> Self {
        if self > other { yes } else { no }
    }

    #[inline(always)]
    fn round(self) -> Self {
        self.round_ties_even()
    }

    #[inline(always)]
    fn power_of_two(self) -> Self {
        f32::from_bits((((self as i32) + 127) as u32) << 23)
    }

    #[inline(always)]
    fn split(self) -> (Self, Self) {
        let bits = self.to_bits();
        (((bits >> 23) as f32) - 127.0, f32::from_bits((bits & 0x007f_ffff) | 0x3f80_0000))
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{LANES, Lane, Vector, Work};
    use std::arch::x86_64::*;
    use std::ops::{Add, Div, Mul, Neg, Sub};

    /// Caller's duty: the processor has AVX2 and FMA.
    #[target_feature(enable = "avx2,fma")]
    pub(super) unsafe fn avx2<W: Work>(work: W) -> W::Output {
        work.run::<V8>()
    }

    /// Caller's duty: the processor has AVX-512 F.
    #[target_feature(enable = "avx512f,avx2,fma")]
    pub(super) unsafe fn avx512<W: Work>(work: W) -> W::Output {
        work.run::<V16>()
    }

    // SAFETY, for every unsafe block below: the types are private to this file and only `avx2` and `avx512` run work with
    // them, whose callers checked the processor. Loads and stores stay inside a `Lane`: the slice checks the bounds.

    /// First lane of a part. The mask changes nothing for a part that exists; it tells the compiler that the slice does.
    #[inline(always)]
    fn first<const WIDTH: usize>(part: usize) -> usize {
        (part * WIDTH) & (LANES - WIDTH)
    }

    macro_rules! operator {
        ($type:ident, $trait:ident, $method:ident, $intrinsic:ident) => {
            impl $trait for $type {
                type Output = Self;
                #[inline(always)]
                fn $method(self, other: Self) -> Self {
                    Self(unsafe { $intrinsic(self.0, other.0) })
                }
            }
        };
    }

    macro_rules! operators {
        ($type:ident, $add:ident, $sub:ident, $mul:ident, $div:ident) => {
            operator!($type, Add, add, $add);
            operator!($type, Sub, sub, $sub);
            operator!($type, Mul, mul, $mul);
            operator!($type, Div, div, $div);
            impl Neg for $type {
                type Output = Self;
                #[inline(always)]
                fn neg(self) -> Self {
                    Self::splat(-0.0) - self
                }
            }
        };
    }

    #[derive(Clone, Copy)]
    pub(super) struct V8(__m256);
    operators!(V8, _mm256_add_ps, _mm256_sub_ps, _mm256_mul_ps, _mm256_div_ps);

    impl Vector for V8 {
        const WIDTH: usize = 8;

        #[inline(always)]
        fn splat(value: f32) -> Self {
            Self(unsafe { _mm256_set1_ps(value) })
        }

        #[inline(always)]
        fn load(from: &Lane, part: usize) -> Self {
            let lanes = &from[first::<8>(part)..][..8];
            Self(unsafe { _mm256_loadu_ps(lanes.as_ptr()) })
        }

        #[inline(always)]
        fn store(self, to: &mut Lane, part: usize) {
            let lanes = &mut to[first::<8>(part)..][..8];
            unsafe { _mm256_storeu_ps(lanes.as_mut_ptr(), self.0) }
        }

        #[inline(always)]
        fn mul_add(self, factor: Self, term: Self) -> Self {
            Self(unsafe { _mm256_fmadd_ps(self.0, factor.0, term.0) })
        }

        #[inline(always)]
        fn sqrt(self) -> Self {
            Self(unsafe { _mm256_sqrt_ps(self.0) })
        }

        #[inline(always)]
        fn if_greater(self, other: Self, yes: Self, no: Self) -> Self {
            Self(unsafe { _mm256_blendv_ps(no.0, yes.0, _mm256_cmp_ps::<_CMP_GT_OQ>(self.0, other.0)) })
        }

        #[inline(always)]
        fn round(self) -> Self {
            Self(unsafe { _mm256_round_ps::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(self.0) })
        }

        #[inline(always)]
        fn power_of_two(self) -> Self {
            Self(unsafe {
                let biased = _mm256_add_epi32(_mm256_cvttps_epi32(self.0), _mm256_set1_epi32(127));
                _mm256_castsi256_ps(_mm256_slli_epi32::<23>(biased))
            })
        }

        #[inline(always)]
        fn split(self) -> (Self, Self) {
            unsafe {
                let bits = _mm256_castps_si256(self.0);
                let exponent = _mm256_cvtepi32_ps(_mm256_srli_epi32::<23>(bits));
                let mantissa = _mm256_or_si256(
                    _mm256_and_si256(bits, _mm256_set1_epi32(0x007f_ffff)),
                    _mm256_set1_epi32(0x3f80_0000),
                );
                (Self(exponent) - Self::splat(127.0), Self(_mm256_castsi256_ps(mantissa)))
            }
        }
    }

    #[derive(Clone, Copy)]
    pub(super) struct V16(__m512);
    operators!(V16, _mm512_add_ps, _mm512_sub_ps, _mm512_mul_ps, _mm512_div_ps);

    impl Vector for V16 {
        const WIDTH: usize = 16;

        #[inline(always)]
        fn splat(value: f32) -> Self {
            Self(unsafe { _mm512_set1_ps(value) })
        }

        #[inline(always)]
        fn load(from: &Lane, part: usize) -> Self {
            let lanes = &from[first::<16>(part)..][..16];
            Self(unsafe { _mm512_loadu_ps(lanes.as_ptr()) })
        }

        #[inline(always)]
        fn store(self, to: &mut Lane, part: usize) {
            let lanes = &mut to[first::<16>(part)..][..16];
            unsafe { _mm512_storeu_ps(lanes.as_mut_ptr(), self.0) }
        }

        #[inline(always)]
        fn mul_add(self, factor: Self, term: Self) -> Self {
            Self(unsafe { _mm512_fmadd_ps(self.0, factor.0, term.0) })
        }

        #[inline(always)]
        fn sqrt(self) -> Self {
            Self(unsafe { _mm512_sqrt_ps(self.0) })
        }

        #[inline(always)]
        fn if_greater(self, other: Self, yes: Self, no: Self) -> Self {
            Self(unsafe { _mm512_mask_blend_ps(_mm512_cmp_ps_mask::<_CMP_GT_OQ>(self.0, other.0), no.0, yes.0) })
        }

        #[inline(always)]
        fn round(self) -> Self {
            Self(unsafe { _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(self.0) })
        }

        #[inline(always)]
        fn power_of_two(self) -> Self {
            Self(unsafe {
                let biased = _mm512_add_epi32(_mm512_cvttps_epi32(self.0), _mm512_set1_epi32(127));
                _mm512_castsi512_ps(_mm512_slli_epi32::<23>(biased))
            })
        }

        #[inline(always)]
        fn split(self) -> (Self, Self) {
            unsafe {
                let bits = _mm512_castps_si512(self.0);
                let exponent = _mm512_cvtepi32_ps(_mm512_srli_epi32::<23>(bits));
                let mantissa = _mm512_or_si512(
                    _mm512_and_si512(bits, _mm512_set1_epi32(0x007f_ffff)),
                    _mm512_set1_epi32(0x3f80_0000),
                );
                (Self(exponent) - Self::splat(127.0), Self(_mm512_castsi512_ps(mantissa)))
            }
        }
    }
}

#[cfg(test)]
mod tests {
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
}
