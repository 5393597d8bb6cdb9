//! The look-ups with byte permutations.
//!
//! Bytes of a group of 64 pixels lie in the order that widening them to f32 by unpacking within 128 bits turns into the natural
//! one: byte 16 l + 4 j + i is that of pixel 16 j + 4 l + i.

use super::{Channel, Into, Levels, UPPER_HALF, WEIGHTS};
use std::arch::x86_64::*;

/// Pixels side by side.
const GROUP: usize = 64;
/// Groups of a block, whose intermediate results stay in the nearest cache.
const GROUPS: usize = 8;
/// Floats of a vector, and vectors of a group.
const FLOATS: usize = 16;
const PARTS: usize = GROUP / FLOATS;

/// What is known of the samples of a group, channel by channel.
#[derive(Clone, Copy)]
struct Samples {
    /// 256 times the number of open frames plus the level of the longest; bytes unpacked: first those of the lower halves of all
    /// 128-bit lanes, then of the upper ones.
    row: [[u16; GROUP]; 3],
    /// Levels of the next shorter frames.
    levels: [[[u8; GROUP]; WEIGHTS]; 3],
}

/// Results of a group, channel by channel.
#[derive(Clone, Copy)]
struct Results {
    sums: [[f32; GROUP]; 3],
    variances: [[f32; GROUP]; 3],
}

/// Caller's duty: the processor has the instruction sets; every slice of `into` has `pixels` elements and every frame three times
/// as many; every channel has more rows than there are frames.
#[target_feature(enable = "avx512f,avx512bw,avx512vbmi,avx2,fma")]
pub(super) unsafe fn look_ups(
    frames: &[&[u8]],
    levels: Levels,
    channels: &[Channel; 3],
    into: &mut Into<'_>,
    pixels: usize,
) -> usize {
    let mut samples = [Samples { row: [[0; GROUP]; 3], levels: [[[0; GROUP]; WEIGHTS]; 3] }; GROUPS];
    let mut results = [Results { sums: [[0.0; GROUP]; 3], variances: [[0.0; GROUP]; 3] }; GROUPS];
    let whole = pixels / GROUP * GROUP;
    for begin in (0..whole).step_by(GROUPS * GROUP) {
        let groups = GROUPS.min((whole - begin) / GROUP);
        for (group, samples) in samples[..groups].iter_mut().enumerate() {
            let at = begin + group * GROUP;
            select(frames, at, levels, samples, &mut into.usable[at..at + GROUP]);
        }
        for (c, channel) in channels.iter().enumerate() {
            for (samples, results) in samples[..groups].iter().zip(&mut results) {
                // SAFETY: `select` counts no more open frames than there are, and there are more rows than frames.
                unsafe { sum(c, samples, channel, results) };
            }
        }
        for (group, results) in results[..groups].iter().enumerate() {
            let at = begin + group * GROUP;
            join(&results.sums, &mut into.sums[at..at + GROUP]);
            join(&results.variances, &mut into.variances[at..at + GROUP]);
        }
    }
    whole
}

/// Finds open frames and levels of the pixels from `first` on, and says which are usable.
#[target_feature(enable = "avx512f,avx512bw,avx512vbmi")]
#[inline]
fn select(frames: &[&[u8]], first: usize, levels: Levels, samples: &mut Samples, usable: &mut [bool]) {
    let (zero, one) = (_mm512_setzero_si512(), _mm512_set1_epi8(1));
    let limit = _mm512_set1_epi8(levels.limit.cast_signed());
    // Red, green and blue lie side by side in three vectors; of each the longest open frame and the next shorter ones.
    let mut seen = [[zero; 3]; 1 + WEIGHTS];
    let mut count = [zero; 3];
    let mut open = [!0_u64; 3];
    for frame in frames {
        let bytes = &frame[3 * first..][..3 * GROUP];
        for (part, bytes) in bytes.as_chunks::<GROUP>().0.iter().enumerate() {
            let level = load(bytes);
            open[part] = _mm512_mask_cmplt_epu8_mask(open[part], level, limit);
            for k in (1..=WEIGHTS).rev() {
                seen[k][part] = _mm512_mask_mov_epi8(seen[k][part], open[part], seen[k - 1][part]);
            }
            seen[0][part] = _mm512_mask_mov_epi8(seen[0][part], open[part], level);
            count[part] = _mm512_mask_add_epi8(count[part], open[part], count[part], one);
        }
        if open == [0; 3] {
            break;
        }
    }
    let lowest = _mm512_set1_epi8(levels.lowest.cast_signed());
    let mut all = !0_u64;
    for c in 0..3 {
        let (count, longest) = (split(c, count), split(c, seen[0]));
        all &= _mm512_test_epi8_mask(count, count) & _mm512_cmpge_epu8_mask(longest, lowest);
        let (low, high) = samples.row[c].split_at_mut(GROUP / 2);
        store_words(_mm512_unpacklo_epi8(longest, count), low);
        store_words(_mm512_unpackhi_epi8(longest, count), high);
        for k in 0..WEIGHTS {
            store(split(c, seen[1 + k]), &mut samples.levels[c][k]);
        }
    }
    let mut bytes = [0; GROUP];
    store(_mm512_permutexvar_epi8(load(&ORDER), _mm512_maskz_mov_epi8(all, one)), &mut bytes);
    for (usable, byte) in usable.iter_mut().zip(bytes) {
        *usable = byte != 0;
    }
}

/// Sums and second results of a channel.
///
/// Caller's duty: every row of `samples` exists.
#[target_feature(enable = "avx512f,avx512bw,avx512vbmi")]
#[inline]
unsafe fn sum(c: usize, samples: &Samples, channel: &Channel, results: &mut Results) {
    let rows = channel.rows.as_flattened().as_ptr().cast::<__m128i>();
    let upper = _mm512_set1_epi32(UPPER_HALF.cast_signed());
    let zero = _mm512_setzero_ps();
    let mut sums = [zero; PARTS];
    let mut weights = [[zero; PARTS]; WEIGHTS];
    for part in 0..PARTS {
        let mut four = [zero; 4];
        for (i, four) in four.iter_mut().enumerate() {
            let byte = 4 * part + i;
            // The byte's place in `row`, and every 8 words on those of the next 128-bit lanes.
            let place = if byte < 8 { byte } else { GROUP / 2 + byte - 8 };
            let row = &samples.row[c];
            // SAFETY: by the caller's duty. A row is 16 bytes, aligned.
            let row = |lane: usize| unsafe { _mm_load_si128(rows.add(usize::from(row[place + 8 * lane]))) };
            let first = _mm512_castsi128_si512(row(0));
            let two = _mm512_inserti32x4::<1>(first, row(1));
            let three = _mm512_inserti32x4::<2>(two, row(2));
            *four = _mm512_castsi512_ps(_mm512_inserti32x4::<3>(three, row(3)));
        }
        let [first, variance, near, far] = transpose(four);
        sums[part] = first;
        store_floats(variance, &mut results.variances[c], part);
        for (k, pair) in [near, far].into_iter().enumerate() {
            let pair = _mm512_castps_si512(pair);
            weights[2 * k][part] = _mm512_castsi512_ps(_mm512_and_si512(pair, upper));
            weights[2 * k + 1][part] = _mm512_castsi512_ps(_mm512_slli_epi32::<16>(pair));
        }
    }
    for (weights, levels) in weights.iter().zip(&samples.levels[c]) {
        let values = values(load(levels), &channel.values);
        for ((sum, weight), value) in sums.iter_mut().zip(weights).zip(values) {
            *sum = _mm512_add_ps(*sum, _mm512_mul_ps(*weight, value));
        }
    }
    for (part, sum) in sums.into_iter().enumerate() {
        store_floats(sum, &mut results.sums[c], part);
    }
}

/// The values of 64 levels.
#[target_feature(enable = "avx512f,avx512bw,avx512vbmi")]
#[inline]
fn values(level: __m512i, tables: &[[u8; 256]; 4]) -> [__m512; PARTS] {
    let upper = _mm512_movepi8_mask(level);
    let mut bytes = [level; 4];
    for (byte, table) in bytes.iter_mut().zip(tables) {
        let [a, b, c, d] = table.as_chunks::<64>().0 else { continue };
        let low = _mm512_permutex2var_epi8(load(a), level, load(b));
        let high = _mm512_permutex2var_epi8(load(c), level, load(d));
        *byte = _mm512_mask_blend_epi8(upper, low, high);
    }
    let [a, b, c, d] = bytes;
    let (low, high) = (_mm512_unpacklo_epi8(a, b), _mm512_unpacklo_epi8(c, d));
    let (low2, high2) = (_mm512_unpackhi_epi8(a, b), _mm512_unpackhi_epi8(c, d));
    [
        _mm512_castsi512_ps(_mm512_unpacklo_epi16(low, high)),
        _mm512_castsi512_ps(_mm512_unpackhi_epi16(low, high)),
        _mm512_castsi512_ps(_mm512_unpacklo_epi16(low2, high2)),
        _mm512_castsi512_ps(_mm512_unpackhi_epi16(low2, high2)),
    ]
}

/// Rows to columns within every 128-bit lane.
#[target_feature(enable = "avx512f")]
#[inline]
fn transpose([a, b, c, d]: [__m512; 4]) -> [__m512; 4] {
    let low = (_mm512_castps_pd(_mm512_unpacklo_ps(a, b)), _mm512_castps_pd(_mm512_unpacklo_ps(c, d)));
    let high = (_mm512_castps_pd(_mm512_unpackhi_ps(a, b)), _mm512_castps_pd(_mm512_unpackhi_ps(c, d)));
    [
        _mm512_castpd_ps(_mm512_unpacklo_pd(low.0, low.1)),
        _mm512_castpd_ps(_mm512_unpackhi_pd(low.0, low.1)),
        _mm512_castpd_ps(_mm512_unpacklo_pd(high.0, high.1)),
        _mm512_castpd_ps(_mm512_unpackhi_pd(high.0, high.1)),
    ]
}

/// Where in a group the byte of a pixel lies; the same the other way round.
const ORDER: [u8; GROUP] = {
    let mut order = [0; GROUP];
    let mut pixel = 0;
    while pixel < GROUP {
        order[pixel] = (16 * (pixel / 4 % 4) + 4 * (pixel / 16) + pixel % 4) as u8;
        pixel += 1;
    }
    order
};

/// For [`split`]: what to take of the first two vectors, then of those and the third.
const SPLIT: [[[u8; GROUP]; 2]; 3] = {
    let mut take = [[[0; GROUP]; 2]; 3];
    let mut i = 0;
    while i < 3 * GROUP {
        let (c, place) = (i / GROUP, i % GROUP);
        let byte = 3 * ORDER[place] as usize + c;
        if byte < 2 * GROUP {
            take[c][0][place] = byte as u8;
            take[c][1][place] = place as u8;
        } else {
            take[c][1][place] = (byte - GROUP) as u8;
        }
        i += 1;
    }
    take
};

/// One channel of 64 pixels side by side.
#[target_feature(enable = "avx512f,avx512vbmi")]
#[inline]
fn split(c: usize, [a, b, last]: [__m512i; 3]) -> __m512i {
    let [first, second] = &SPLIT[c];
    _mm512_permutex2var_epi8(_mm512_permutex2var_epi8(a, load(first), b), load(second), last)
}

/// For [`join`]: what to take of the first two channels, then of those and the third.
const JOIN: [[[u32; FLOATS]; 2]; 3] = {
    let mut take = [[[0; FLOATS]; 2]; 3];
    let mut i = 0;
    while i < 3 * FLOATS {
        let (part, place, pixel, c) = (i / FLOATS, i % FLOATS, i / 3, i % 3);
        if c < 2 {
            take[part][0][place] = (c * FLOATS + pixel) as u32;
            take[part][1][place] = place as u32;
        } else {
            take[part][1][place] = (FLOATS + pixel) as u32;
        }
        i += 1;
    }
    take
};

/// Channels to pixels.
#[target_feature(enable = "avx512f")]
#[inline]
fn join(channels: &[[f32; GROUP]; 3], pixels: &mut [[f32; 3]]) {
    let floats = pixels.as_flattened_mut().as_chunks_mut::<{ 3 * FLOATS }>().0;
    for (part, floats) in floats.iter_mut().enumerate() {
        let [red, green, blue] = [0, 1, 2].map(|c| &channels[c].as_chunks::<FLOATS>().0[part]);
        for (k, [first, second]) in JOIN.iter().enumerate() {
            // SAFETY: each is as long as a vector.
            unsafe {
                let (first, second) = (load_words(first), load_words(second));
                let two = _mm512_permutex2var_ps(_mm512_loadu_ps(red.as_ptr()), first, _mm512_loadu_ps(green.as_ptr()));
                let all = _mm512_permutex2var_ps(two, second, _mm512_loadu_ps(blue.as_ptr()));
                _mm512_storeu_ps(floats[FLOATS * k..][..FLOATS].as_mut_ptr(), all);
            }
        }
    }
}

// SAFETY, for the loads and stores below: arrays and slices are as long as a vector, or the slice checks it.

#[target_feature(enable = "avx512f")]
#[inline]
fn load(bytes: &[u8; GROUP]) -> __m512i {
    unsafe { _mm512_loadu_si512(bytes.as_ptr().cast()) }
}

#[target_feature(enable = "avx512f")]
#[inline]
fn load_words(words: &[u32; FLOATS]) -> __m512i {
    unsafe { _mm512_loadu_si512(words.as_ptr().cast()) }
}

#[target_feature(enable = "avx512f")]
#[inline]
fn store(vector: __m512i, bytes: &mut [u8; GROUP]) {
    unsafe { _mm512_storeu_si512(bytes.as_mut_ptr().cast(), vector) }
}

#[target_feature(enable = "avx512f")]
#[inline]
fn store_words(vector: __m512i, words: &mut [u16]) {
    unsafe { _mm512_storeu_si512(words[..GROUP / 2].as_mut_ptr().cast(), vector) }
}

#[target_feature(enable = "avx512f")]
#[inline]
fn store_floats(vector: __m512, floats: &mut [f32; GROUP], part: usize) {
    unsafe { _mm512_storeu_ps(floats[FLOATS * part..][..FLOATS].as_mut_ptr(), vector) }
}
