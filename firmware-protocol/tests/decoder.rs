//! The decoder and the handler under noise, flips and hostile bytes. Seeds are fixed, so a failure repeats.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod board;

use board::Board;
use firmware_protocol::{Decoder, Device, Frame, MAX_WIRE, Payload, Request};
use proptest::prelude::*;
use proptest::test_runner::{RngAlgorithm, TestRng, TestRunner};

fn runner(cases: u32) -> TestRunner {
    let config = ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() };
    TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha))
}

fn any_frame() -> impl Strategy<Value = Frame> {
    let payload = prop::collection::vec(any::<u8>(), 0..=48);
    (any::<u8>(), any::<u16>(), any::<u32>(), payload)
        .prop_map(|(kind, seq, session, payload)| Frame::new(kind, seq, session, Payload::new(&payload).unwrap()))
}

fn decode(bytes: &[u8]) -> Vec<Frame> {
    let mut decoder = Decoder::default();
    bytes.iter().filter_map(|byte| decoder.push(*byte)).collect()
}

#[test]
fn every_frame_survives_the_round_trip() {
    runner(2000)
        .run(&any_frame(), |frame| {
            let wire = frame.to_wire();
            prop_assert!(wire.as_slice().len() <= MAX_WIRE);
            prop_assert_eq!(decode(wire.as_slice()), vec![frame]);
            Ok(())
        })
        .unwrap();
}

#[test]
fn any_single_flipped_bit_is_rejected() {
    runner(200)
        .run(&any_frame(), |frame| {
            let wire = frame.to_wire();
            for bit in 0..wire.as_slice().len() * 8 {
                let mut flipped = wire.as_slice().to_vec();
                flipped[bit / 8] ^= 1 << (bit % 8);
                // A further zero byte ends the frame even where the flip hit its last one.
                flipped.push(0);
                prop_assert_eq!(decode(&flipped), vec![], "bit {} was not noticed", bit);
            }
            Ok(())
        })
        .unwrap();
}

#[test]
fn a_frame_behind_any_noise_is_heard() {
    let noise = prop::collection::vec(any::<u8>(), 0..300);
    runner(2000)
        .run(&(noise, any_frame()), |(noise, frame)| {
            let mut bytes = noise;
            bytes.extend_from_slice(frame.to_wire().as_slice());
            let frames = decode(&bytes);
            prop_assert_eq!(frames.last(), Some(&frame));
            Ok(())
        })
        .unwrap();
}

/// SplitMix64: a generator small enough to read, so that the million strings cost no more than the decoder.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
    fn below(&mut self, bound: usize) -> usize {
        (self.next() % bound as u64) as usize
    }
}

/// A string of 0 to 80 random bytes, or a valid frame with up to four bytes changed, lost or doubled.
fn hostile(random: &mut Random, bytes: &mut Vec<u8>) {
    bytes.clear();
    if random.below(2) == 0 {
        bytes.extend((0..random.below(81)).map(|_| random.next() as u8));
        return;
    }
    let payload: Vec<u8> = (0..random.below(12)).map(|_| random.next() as u8).collect();
    let kind = random.below(9) as u8;
    // A small session and sequence range, so that frames also pass the handler's first gates.
    let (seq, session) = (random.below(4) as u16, 1 + random.below(2) as u32);
    bytes.extend_from_slice(Frame::new(kind, seq, session, Payload::new(&payload).unwrap()).to_wire().as_slice());
    for _ in 0..random.below(5) {
        let at = random.below(bytes.len().max(1));
        match (random.below(3), bytes.is_empty()) {
            (_, true) => {}
            (0, _) => bytes[at] = random.next() as u8,
            (1, _) => drop(bytes.remove(at)),
            _ => bytes.insert(at, bytes[at]),
        }
    }
}

#[test]
fn a_million_hostile_strings_never_panic_nor_deafen_the_device() {
    let mut random = Random(20260101);
    let mut decoder = Decoder::default();
    let mut device = Device::new(Board::default(), board::INFO, 0);
    let (mut bytes, mut frames) = (Vec::new(), 0u32);
    for round in 0..1_000_000u32 {
        hostile(&mut random, &mut bytes);
        for byte in &bytes {
            if let Some(frame) = decoder.push(*byte) {
                frames += 1;
                let answer = device.handle(&frame, round);
                assert_eq!((answer.seq, answer.session), (frame.seq, frame.session));
            }
        }
    }
    assert!(frames > 100_000, "only {frames} frames got through: the strings test nothing");
    assert!(decoder.rejected() > 100_000);
    let sane = Request::Status.to_frame(9, 9);
    assert_eq!(sane.to_wire().as_slice().iter().filter_map(|byte| decoder.push(*byte)).last(), Some(sane));
}
