//! Whatever a host asks, the body answers.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod support;

use proptest::prelude::*;
use simulated_eos::{Body, BodyOptions, OpRequest, Release};
use support::TextSensor;

/// Codes that exist, mostly, and handles and properties that may.
fn request() -> impl Strategy<Value = OpRequest> {
    let code = prop_oneof![
        4 => 0x1001_u16..0x101d,
        8 => 0x9101_u16..0x912b,
        1 => any::<u16>(),
    ];
    let number = prop_oneof![
        4 => 0_u32..6,
        4 => 0x9000_0000_u32..0x9000_0010,
        4 => 0xd101_u32..0xd125,
        2 => Just(0x0002_0001),
        1 => any::<u32>(),
    ];
    let word = number.clone().prop_map(|word| word.to_le_bytes().to_vec());
    let data = prop_oneof![
        proptest::collection::vec(word, 0..12).prop_map(|words| words.concat()),
        proptest::collection::vec(any::<u8>(), 0..50),
    ];
    (code, proptest::collection::vec(number, 0..6), data).prop_map(|(code, params, data)| OpRequest {
        code,
        params,
        data,
    })
}

proptest! {
    #[test]
    fn every_request_has_an_answer(requests in proptest::collection::vec(request(), 1..150), buttons in any::<bool>()) {
        let release = if buttons { Release::Buttons } else { Release::Command };
        let mut body = Body::new(Box::new(TextSensor), BodyOptions { release, card_files: 3, ..BodyOptions::default() }).unwrap();
        body.handle(&OpRequest { code: 0x1002, params: vec![1], data: vec![] });
        for request in requests {
            let answer = body.handle(&request);
            prop_assert!((0x2001..0x2100).contains(&answer.code), "{request:x?}: {:x}", answer.code);
            prop_assert!(answer.params.len() <= 5);
            prop_assert!(answer.data.is_none() || answer.code == 0x2001, "{request:x?}");
        }
    }
}
