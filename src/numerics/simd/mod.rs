//! Vectors of f32 for the fit's inner loops, with the instruction set chosen at run time: AVX-512, AVX2 with FMA, or one
//! lane at a time; and look-ups of bytes for the merge. This is the one module with `unsafe`.
//!
//! Every instruction used is correctly rounded (fused multiply-add included) and lanes never mix, so that all three give the
//! same bits: the one-lane version is the twin the others are tested against.
#![allow(unsafe_code)]

pub mod look_ups;

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
    /// True if `self > other` in some lane.
    fn any_greater(self, other: Self) -> bool;
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
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
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
            match self.min(Self::best()) {
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
    fn any_greater(self, other: Self) -> bool {
        self > other
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
mod x86;

#[cfg(test)]
mod tests;
