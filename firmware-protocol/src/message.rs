//! What frames mean. Angles are i32 millidegrees, times u32 milliseconds, lamp levels u16 permille of full.
//!
//! Append-only: a kind, code or bit once given keeps its number and its layout for ever (`golden/v1.json`).

mod wire;

/// Full lamp, permille.
pub const MAX_LAMP_PERMILLE: u16 = 1000;

/// Numbers of the kinds of frames.
mod kind {
    pub const HELLO: u8 = 0x01;
    pub const MOVE_TO: u8 = 0x02;
    pub const STATUS: u8 = 0x03;
    pub const HOME: u8 = 0x04;
    pub const STOP: u8 = 0x05;
    pub const SET_LAMP: u8 = 0x06;
    pub const CLEAR_FAULT: u8 = 0x07;
    pub const HELLO_ACK: u8 = 0x81;
    pub const ACCEPTED: u8 = 0x82;
    pub const STATUS_REPORT: u8 = 0x83;
    pub const ERROR: u8 = 0x84;
}

/// Bits of [`HelloAck::caps`].
pub mod caps {
    /// The lamp has levels between off and full.
    pub const DIMMING: u16 = 1 << 0;
    /// The device makes itself safe when the host falls silent.
    pub const DEAD_MAN: u16 = 1 << 1;
    /// Lost steps are found at the home switch's edge.
    pub const STEP_LOSS_CHECK: u16 = 1 << 2;
    /// The boot nonce changes with every boot.
    pub const REBOOT_DETECT: u16 = 1 << 3;
}

/// Opens a session: the one named in the frame's header, which must not be 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hello {
    /// Oldest protocol version the host speaks.
    pub proto_min: u8,
    /// Newest protocol version the host speaks.
    pub proto_max: u8,
}

/// What the host asks. All commands are absolute, so doing one twice does no harm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// Opens a session.
    Hello(Hello),
    /// Turns to an angle.
    MoveTo {
        /// Absolute angle, millidegrees.
        target_mdeg: i32,
        /// Chosen by the host; every status repeats the last one accepted.
        move_id: u32,
    },
    /// Asks for a [`Status`].
    Status,
    /// Finds the home switch.
    Home {
        /// As for `MoveTo`.
        move_id: u32,
    },
    /// Slows down and holds.
    Stop,
    /// Sets the lamp.
    SetLamp {
        /// Permille of full.
        level_permille: u16,
        /// Longest time the lamp stays on without another `SetLamp`, milliseconds; ignored at level 0.
        ttl_ms: u32,
    },
    /// Forgets latched faults.
    ClearFault,
}

/// Who the device is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HelloAck {
    /// Protocol version spoken from here on.
    pub proto: u8,
    /// Firmware version: major, minor, patch.
    pub firmware: [u8; 3],
    /// Abilities, bits of [`caps`].
    pub caps: u16,
    /// The board's own number for why it last started.
    pub reset_cause: u8,
    /// True once homed since the last boot.
    pub homed: bool,
    /// Another number after every boot.
    pub boot_nonce: u32,
    /// Time since boot, milliseconds; wraps.
    pub uptime_ms: u32,
    /// Permitted angles, millidegrees, lower and upper.
    pub travel_mdeg: [i32; 2],
}

/// What the device does, as one byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum State {
    /// The motor stands.
    Idle = 0,
    /// Looking for the switch.
    Homing = 1,
    /// Turning to a target.
    Moving = 2,
    /// Slowing down.
    Stopping = 3,
    /// A fault is latched; motor stopped, lamp off.
    Faulted = 4,
}

/// Latched faults: bit n stands for error code 9 + n.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults(pub u16);

impl Faults {
    /// The switch was not found within the search travel.
    pub const HOME_FAILED: Self = Self(1 << 0);
    /// The switch does not open again.
    pub const SWITCH_STUCK: Self = Self(1 << 1);
    /// The switch's edge came at the wrong step count.
    pub const STEP_LOSS: Self = Self(1 << 2);
    /// The dead-man time-out ran out.
    pub const HOST_LOST: Self = Self(1 << 3);
    /// The lamp draws no current, or too much.
    pub const LAMP_FAULT: Self = Self(1 << 4);
    /// Motor driver or lamp is too hot.
    pub const OVER_TEMP: Self = Self(1 << 5);

    /// True when nothing is latched.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// These and those.
    pub fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// These without those.
    pub fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// True when every bit of `other` is here.
    pub fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

/// What the device says of itself; polling it is the only proof that a command is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Status {
    /// Id of the last accepted `MoveTo` or `Home`; 0 after a boot.
    pub move_id: u32,
    /// Another number after every boot.
    pub boot_nonce: u32,
    /// Counted angle, millidegrees.
    pub position_mdeg: i32,
    /// Lamp level, permille of full.
    pub lamp_permille: u16,
    /// Latched faults.
    pub faults: Faults,
    /// What the device does.
    pub state: State,
    /// True once homed since the last boot.
    pub homed: bool,
    /// True while the motor turns.
    pub moving: bool,
    /// True while the home switch is pressed.
    pub at_switch: bool,
}

/// Why a request was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum ErrorCode {
    /// Frame or `Hello` of another protocol version.
    BadVersion = 1,
    /// The session is not the open one.
    BadSession = 2,
    /// No such request.
    UnknownKind = 3,
    /// The payload has another length than its kind.
    BadLength = 4,
    /// Angle outside the travel, or lamp level above full.
    OutOfRange = 5,
    /// The position is not known: home first.
    NotHomed = 6,
    /// The motor turns: stop first.
    Busy = 7,
    /// A fault is latched: clear it first.
    Faulted = 8,
    /// See [`Faults::HOME_FAILED`].
    HomeFailed = 9,
    /// See [`Faults::SWITCH_STUCK`].
    SwitchStuck = 10,
    /// See [`Faults::STEP_LOSS`].
    StepLoss = 11,
    /// See [`Faults::HOST_LOST`].
    HostLost = 12,
    /// See [`Faults::LAMP_FAULT`].
    LampFault = 13,
    /// See [`Faults::OVER_TEMP`].
    OverTemp = 14,
    /// The sequence number is older than the last one.
    StaleSequence = 15,
}

impl ErrorCode {
    const ALL: [Self; 15] = [
        Self::BadVersion,
        Self::BadSession,
        Self::UnknownKind,
        Self::BadLength,
        Self::OutOfRange,
        Self::NotHomed,
        Self::Busy,
        Self::Faulted,
        Self::HomeFailed,
        Self::SwitchStuck,
        Self::StepLoss,
        Self::HostLost,
        Self::LampFault,
        Self::OverTemp,
        Self::StaleSequence,
    ];

    fn from_u8(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|known| *known as u8 == code)
    }
}

/// What the device answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// The session is open.
    HelloAck(HelloAck),
    /// The command was taken; it is not done yet.
    Accepted,
    /// The status asked for.
    Status(Status),
    /// The request was not taken.
    Error(ErrorCode),
}
