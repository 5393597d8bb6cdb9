//! What a GRBL controller says, line by line (grbl 1.1 wiki, "Interface"); unknown lines and fields are ignored, as its manual asks.

/// One line from the controller.
#[derive(Clone, Debug, PartialEq)]
pub enum Said {
    /// The line sent last was taken.
    Ok,
    /// It was refused, with this number.
    Error(u8),
    /// The controller locked itself, with this number.
    Alarm(u8),
    /// It has just started: who it is.
    Banner(String),
    /// Answer to `?`.
    Report(Report),
    /// Anything else: an answer to `$I` or `$$`, a message, noise.
    Other(String),
}

/// What the controller is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// Nothing; every queued motion is done.
    Idle,
    /// Moving: Run, Home or Jog.
    Moving,
    /// Slowing down after `!`.
    Slowing,
    /// Standing after `!`.
    Held,
    /// Locked.
    Alarm,
    /// Door, Check, Sleep, or a word unknown here.
    Other,
}

/// A status report: angles in the controller's degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// What it is doing.
    pub state: State,
    /// Machine position of the X axis, degrees.
    pub position_deg: f64,
    /// Programmed spindle speed, if stated; not yet held against `$30`.
    pub spindle: Option<f64>,
    /// True while the X limit pin is active.
    pub at_switch: bool,
    /// Stated in some reports only.
    pub outputs: Option<Outputs>,
}

/// Overrides and accessory outputs, stated together every tenth to thirtieth report: beside `Ov:` every output that is on has its
/// letter in `A:`, and `A:` is left out when none is. Without `Ov:` nothing is said of those that are off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outputs {
    /// Feed, rapids and spindle at 100 %.
    pub plain: bool,
    /// Flood or mist coolant on.
    pub coolant: bool,
    /// Spindle on.
    pub spindle: bool,
}

impl Said {
    /// Of one line without its end.
    pub fn of(line: &str) -> Self {
        let line = line.trim();
        if line == "ok" {
            return Self::Ok;
        }
        let number = |prefix: &str| line.strip_prefix(prefix).and_then(|rest| rest.trim().parse().ok());
        if let Some(code) = number("error:") {
            return Self::Error(code);
        }
        if let Some(code) = number("ALARM:") {
            return Self::Alarm(code);
        }
        if line.starts_with("Grbl 1.1") || line.starts_with("GrblHAL ") {
            return Self::Banner(line.to_owned());
        }
        Report::of(line).map_or_else(|| Self::Other(line.to_owned()), Self::Report)
    }
}

impl Report {
    /// `<Idle|MPos:0.000,0.000,0.000|FS:0,0|...>`; none for anything else, and for a report without a machine position.
    fn of(line: &str) -> Option<Self> {
        // Two reports that noise has made one line of prove nothing.
        let mut fields = line.strip_prefix('<')?.strip_suffix('>').filter(|inside| !inside.contains('<'))?.split('|');
        let state = match fields.next()? {
            "Idle" => State::Idle,
            "Run" | "Home" | "Jog" => State::Moving,
            "Hold:1" => State::Slowing,
            "Hold:0" => State::Held,
            "Alarm" => State::Alarm,
            _ => State::Other,
        };
        let (mut position, mut spindle, mut at_switch, mut plain, mut on) = (None, None, false, None, "");
        for field in fields {
            let Some((name, value)) = field.split_once(':') else { continue };
            let mut numbers = value.split(',').map(str::parse::<f64>);
            match name {
                "MPos" => position = numbers.next()?.ok().filter(|x| x.is_finite()),
                "FS" => spindle = numbers.nth(1).and_then(Result::ok),
                "Pn" => at_switch = value.contains('X'),
                "Ov" => plain = Some(value == "100,100,100"),
                "A" => on = value,
                _ => {}
            }
        }
        let sensible = on.bytes().all(|letter| letter.is_ascii_uppercase());
        let outputs = plain.filter(|_| sensible).map(|plain| Outputs {
            plain,
            coolant: on.contains(['F', 'M']),
            spindle: on.contains(['S', 'C']),
        });
        Some(Self { state, position_deg: position?, spindle, at_switch, outputs })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(line: &str) -> Option<Report> {
        match Said::of(line) {
            Said::Report(report) => Some(report),
            _ => None,
        }
    }

    /// Lines recorded from GRBL 1.1h and grblHAL.
    #[test]
    fn recorded_lines_are_understood() {
        assert_eq!(Said::of("ok\r"), Said::Ok);
        assert_eq!(Said::of("error:9"), Said::Error(9));
        assert_eq!(Said::of("ALARM:3"), Said::Alarm(3));
        assert!(matches!(Said::of("Grbl 1.1h ['$' for help]"), Said::Banner(_)));
        assert!(matches!(Said::of("GrblHAL 1.1f ['$' or '$HELP' for help]"), Said::Banner(_)));
        let idle = report("<Idle|MPos:-99.991,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>");
        let expected =
            Report { state: State::Idle, position_deg: -99.991, spindle: Some(0.0), at_switch: false, outputs: None };
        assert_eq!(idle, Some(expected));
        let on = report("<Run|MPos:-12.5,0.000,0.000|FS:1440,500|Ov:100,100,100|A:S>");
        let outputs = Some(Outputs { plain: true, coolant: false, spindle: true });
        assert_eq!(on.map(|r| (r.state, r.spindle, r.outputs)), Some((State::Moving, Some(500.0), outputs)));
        let odd = report("<Hold:0|MPos:0.000,0.000,0.000|Bf:100,1023|FS:0,0|Pn:XZ|Ov:100,100,90|A:FM|TLR:0>");
        let outputs = Some(Outputs { plain: false, coolant: true, spindle: false });
        assert_eq!(odd.map(|r| (r.state, r.at_switch, r.outputs)), Some((State::Held, true, outputs)));
    }

    #[test]
    fn outputs_are_off_only_where_a_report_lists_those_that_are_on() {
        let outputs =
            |tail: &str| report(&format!("<Idle|MPos:0.000,0.000,0.000|FS:0,0{tail}>")).and_then(|r| r.outputs);
        let off = Outputs { plain: true, coolant: false, spindle: false };
        assert_eq!(outputs("|Ov:100,100,100"), Some(off));
        assert_eq!(outputs("|Ov:100,100,100|A:"), Some(off));
        assert_eq!(outputs("|Ov:100,100,100|A:CM"), Some(Outputs { plain: true, coolant: true, spindle: true }));
        // GRBL's other reports, grblHAL's at a change, and noise.
        for tail in ["", "|A:F", "|Ov:100,100,100|A:f", "|Ov:100,100,100|A:\u{fffd}"] {
            assert_eq!(outputs(tail), None, "{tail}");
        }
    }

    #[test]
    fn what_is_cut_or_garbled_is_no_report() {
        for line in [
            "<Idle|MPos:-9",
            "<Idle|MPos:abc,0,0|FS:0,0>",
            "<Idle|FS:0,0>",
            "<Idle|MPos:-9.000,0,0|FS:0,8<Idle|MPos:-9.000,0,0|FS:0,0|Ov:100,100,100>",
            "<Idle|MPos:nan,0,0|FS:0,0>",
            "<Idle|MPos:inf,0,0|FS:0,0>",
            "<>",
            "error:",
            "ok?",
            "o",
            "",
            "2500, 0, 0",
        ] {
            assert!(matches!(Said::of(line), Said::Other(_)), "{line}");
        }
    }
}
