//! The home switch without its bounces.

/// A level counts once it has stood for the given time; where it came about is remembered from its first moment.
#[derive(Clone, Copy, Debug)]
pub struct Switch {
    steady_us: u32,
    raw: bool,
    since_us: u32,
    since_count: i32,
    pressed: bool,
    edge_count: i32,
}

impl Switch {
    /// A switch read for the first time.
    pub fn new(steady_us: u32, raw: bool, now_us: u32) -> Self {
        Self { steady_us, raw, since_us: now_us, since_count: 0, pressed: raw, edge_count: 0 }
    }

    /// Takes what the pin says now, with the motor at `count`; true when that makes another level believed.
    pub fn sample(&mut self, raw: bool, now_us: u32, count: i32) -> bool {
        if raw != self.raw {
            (self.raw, self.since_us, self.since_count) = (raw, now_us, count);
        }
        let believed = raw != self.pressed && now_us.wrapping_sub(self.since_us) >= self.steady_us;
        if believed {
            (self.pressed, self.edge_count) = (raw, self.since_count);
        }
        believed
    }

    /// True while pressed.
    pub fn pressed(&self) -> bool {
        self.pressed
    }

    /// The count at which the level of now came about.
    pub fn edge_count(&self) -> i32 {
        self.edge_count
    }
}
