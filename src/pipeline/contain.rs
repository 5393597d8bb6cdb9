//! Decoders made by others may panic on crafted files. Such a file is damaged, and nothing else is lost.

use std::cell::Cell;
use std::panic::{UnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;

thread_local! {
    static CONTAINED: Cell<bool> = const { Cell::new(false) };
}

static HOOK: Once = Once::new();

/// What a decoder gives, or None if it panics; of such a panic nothing is printed.
pub fn contained<T>(decoder: impl FnOnce() -> T + UnwindSafe) -> Option<T> {
    HOOK.call_once(|| {
        let others = take_hook();
        set_hook(Box::new(move |info| {
            if !CONTAINED.get() {
                others(info);
            }
        }));
    });
    CONTAINED.set(true);
    let result = catch_unwind(decoder);
    CONTAINED.set(false);
    result.ok()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::panic)]
    use super::*;

    #[test]
    fn a_panic_ends_the_decoder_and_nothing_else() {
        assert_eq!(contained(|| 7), Some(7));
        assert_eq!(contained(|| -> u8 { panic!("a crafted file") }), None);
        assert!(!CONTAINED.get(), "later panics are told again");
        assert_eq!(contained(|| 8), Some(8));
    }
}
