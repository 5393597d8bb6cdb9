//! Any bytes into the decoder; what it takes for frames into the device and into both message readers.
#![no_main]

use firmware_protocol::{Answer, Decoder, Device, DeviceInfo, Hal, Motor, Request};
use libfuzzer_sys::fuzz_target;

#[derive(Default)]
struct Board(Motor);

impl Hal for Board {
    fn motor(&self) -> Motor {
        self.0
    }
    fn start_move(&mut self, target_mdeg: i32) {
        assert!((-90_000..=90_000).contains(&target_mdeg), "sent outside the travel");
        self.0.position_mdeg = target_mdeg;
    }
    fn start_home(&mut self) {
        self.0.homed = true;
    }
    fn decelerate(&mut self) {}
    fn set_lamp(&mut self, permille: u16) {
        assert!(permille <= 1000, "lamp above full");
    }
    fn clear_faults(&mut self) {}
}

fuzz_target!(|bytes: &[u8]| {
    let info =
        DeviceInfo { firmware: [0, 1, 0], caps: 0, reset_cause: 0, boot_nonce: 1, travel_mdeg: [-90_000, 90_000] };
    let mut device = Device::new(Board::default(), info, 0);
    let mut decoder = Decoder::default();
    for (now_ms, byte) in (0u32..).zip(bytes) {
        let Some(frame) = decoder.push(*byte) else { continue };
        let _ = Answer::from_frame(&frame);
        let answer = device.handle(&frame, now_ms);
        assert_eq!((answer.seq, answer.session), (frame.seq, frame.session));
        assert!(Answer::from_frame(&answer).is_ok(), "an answer nobody can read");
        if let Ok(request) = Request::from_frame(&frame) {
            let again = request.to_frame(frame.seq, frame.session);
            assert_eq!(again.payload, frame.payload, "read and written differ");
        }
    }
});
