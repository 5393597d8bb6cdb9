//! The body's properties and what it offers for them.

use super::events::record;
use crate::card::CARD;
use crate::codes::{event, property, response};
use crate::dials::{Aperture, ImageFormat, Iso, Shutter};
use crate::pack::{Pack, count, u32_at};

/// Where a picture goes.
pub(super) const TO_CARD: u32 = 2;
/// Where a picture goes: to the host, over the body's memory.
pub(super) const TO_HOST: u32 = 4;

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value {
    Number(u32),
    Text(String),
    Format(ImageFormat),
}

impl Value {
    fn bytes(&self) -> Vec<u8> {
        match self {
            Self::Number(number) => number.to_le_bytes().to_vec(),
            Self::Text(text) => Pack::default().bytes(text.as_bytes()).u8(0).0,
            Self::Format(format) => format.bytes(),
        }
    }

    /// A value of this one's kind; a text is never set by the host.
    fn parse(&self, bytes: &[u8]) -> Option<Self> {
        match self {
            Self::Number(_) => u32_at(bytes, 0).map(Self::Number),
            Self::Format(_) => ImageFormat::from_bytes(bytes).map(Self::Format),
            Self::Text(_) => None,
        }
    }
}

#[derive(Debug)]
struct Property {
    code: u32,
    value: Value,
    /// What the host may set; empty if it may not.
    offered: Vec<Value>,
}

/// All properties, in the order in which they are told.
#[derive(Debug)]
pub(super) struct Settings(Vec<Property>);

impl Settings {
    pub(super) fn new(serial: &str, shots: u32) -> Self {
        let fixed = |code, number| Property { code, value: Value::Number(number), offered: Vec::new() };
        let text = |code, text: &str| Property { code, value: Value::Text(text.into()), offered: Vec::new() };
        let dial = |code, number, offered: Vec<u32>| Property {
            code,
            value: Value::Number(number),
            offered: offered.into_iter().map(Value::Number).collect(),
        };
        let format = Property {
            code: property::IMAGE_FORMAT,
            value: Value::Format(ImageFormat::Jpeg),
            offered: ImageFormat::ALL.map(Value::Format).to_vec(),
        };
        Self(vec![
            dial(property::APERTURE, 0x30, Aperture::all().map(|aperture| aperture.code).collect()),
            dial(property::SHUTTER_SPEED, 0x6d, Shutter::all().map(|shutter| shutter.code).collect()),
            dial(property::ISO_SPEED, 0x48, Iso::all().map(|iso| iso.code).collect()),
            fixed(property::AUTO_EXPOSURE_MODE, 3), // M
            fixed(property::DRIVE_MODE, 0),
            fixed(property::FOCUS_MODE, 3),    // manual
            fixed(property::BATTERY_POWER, 2), // 100 %
            fixed(property::AUTO_POWER_OFF, 0),
            text(property::OWNER, ""),
            fixed(property::MODEL_ID, 0x8000_0218),
            fixed(property::AVAILABLE_SHOTS, shots),
            dial(property::CAPTURE_DESTINATION, TO_CARD, vec![TO_CARD, TO_HOST]),
            fixed(property::CURRENT_STORAGE, CARD),
            format,
            text(property::SERIAL_NUMBER, serial),
            fixed(property::EVF_OUTPUT, 0),
            text(property::ARTIST, ""),
            text(property::COPYRIGHT, ""),
        ])
    }

    /// Sets what a host sent as 0x9110's data: size, property, value. Returns the property.
    pub(super) fn set(&mut self, data: &[u8]) -> Result<u32, u16> {
        let (code, value) = u32_at(data, 4).zip(data.get(8..)).ok_or(response::PARAMETER_NOT_SUPPORTED)?;
        let property = self.0.iter_mut().find(|property| property.code == code);
        let property = property.ok_or(response::DEVICE_PROP_NOT_SUPPORTED)?;
        if property.offered.is_empty() {
            return Err(response::ACCESS_DENIED);
        }
        // A guess: no dump shows what a body answers to a value it does not offer.
        let value = property.value.parse(value).filter(|value| property.offered.contains(value));
        property.value = value.ok_or(response::INVALID_DEVICE_PROP_VALUE)?;
        Ok(code)
    }

    /// Sets a number; true if it was another one before.
    pub(super) fn update(&mut self, code: u32, number: u32) -> bool {
        let property = self.0.iter_mut().find(|property| property.code == code);
        property.is_some_and(|property| {
            std::mem::replace(&mut property.value, Value::Number(number)) != Value::Number(number)
        })
    }

    pub(super) fn number(&self, code: u32) -> Option<u32> {
        match self.find(code)?.value {
            Value::Number(number) => Some(number),
            Value::Text(_) | Value::Format(_) => None,
        }
    }

    pub(super) fn format(&self) -> ImageFormat {
        match self.find(property::IMAGE_FORMAT).map(|property| &property.value) {
            Some(Value::Format(format)) => *format,
            _ => ImageFormat::Jpeg,
        }
    }

    /// The record that tells a property's value.
    pub(super) fn value_record(&self, code: u32) -> Option<Vec<u8>> {
        let payload = Pack::default().u32(code).bytes(&self.find(code)?.value.bytes());
        Some(record(event::PROP_VALUE_CHANGED, &payload.0))
    }

    /// Every value, then every list of choices: libgphoto2 knows no list of a property whose value it has not seen.
    pub(super) fn all_records(&self) -> Vec<Vec<u8>> {
        let values = self.0.iter().filter_map(|property| self.value_record(property.code));
        let lists = self.0.iter().filter(|property| !property.offered.is_empty()).map(|property| {
            let start = Pack::default().u32(property.code).u32(3).u32(count(property.offered.len()));
            let payload = property.offered.iter().fold(start, |pack, value| pack.bytes(&value.bytes()));
            record(event::AVAIL_LIST_CHANGED, &payload.0)
        });
        values.chain(lists).collect()
    }

    fn find(&self, code: u32) -> Option<&Property> {
        self.0.iter().find(|property| property.code == code)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn sent(code: u32, value: &[u8]) -> Vec<u8> {
        Pack::default().u32(count(value.len() + 8)).u32(code).bytes(value).0
    }

    #[test]
    fn only_what_is_offered_can_be_set() {
        let mut settings = Settings::new("1", 5);
        let tv = property::SHUTTER_SPEED;
        assert_eq!(settings.set(&sent(tv, &0x18_u32.to_le_bytes())), Ok(tv));
        assert_eq!(settings.number(tv), Some(0x18));
        let half_stop = sent(tv, &0x3c_u32.to_le_bytes());
        assert_eq!(settings.set(&half_stop), Err(response::INVALID_DEVICE_PROP_VALUE));
        assert_eq!(settings.number(tv), Some(0x18));
        assert_eq!(settings.set(&sent(property::SERIAL_NUMBER, b"x")), Err(response::ACCESS_DENIED));
        assert_eq!(settings.set(&sent(0xd1ff, &[0; 4])), Err(response::DEVICE_PROP_NOT_SUPPORTED));
        assert_eq!(settings.set(&[1, 2, 3]), Err(response::PARAMETER_NOT_SUPPORTED));
        assert_eq!(settings.set(&sent(tv, &[])), Err(response::INVALID_DEVICE_PROP_VALUE));
    }

    /// Offsets of libgphoto2 2.5.30, camlibs/ptp2/ptp-pack.c (PTP_ece_Prop_*).
    #[test]
    fn values_come_before_the_lists_of_their_choices() {
        let records = Settings::new("0123", 5).all_records();
        let of = |kind, code| {
            records
                .iter()
                .position(|record| u32_at(record, 4) == Some(kind) && u32_at(record, 8) == Some(code))
                .unwrap()
        };
        let (value, list) = (
            of(event::PROP_VALUE_CHANGED, property::SHUTTER_SPEED),
            of(event::AVAIL_LIST_CHANGED, property::SHUTTER_SPEED),
        );
        assert!(value < list);
        assert_eq!(u32_at(&records[value], 0xc), Some(0x6d));
        let fields = [0xc, 0x10, 0x14, 0x14 + 4 * 54].map(|offset| u32_at(&records[list], offset).unwrap());
        assert_eq!(fields, [3, 55, 0x10, 0xa0]);
        assert_eq!(&records[of(event::PROP_VALUE_CHANGED, property::SERIAL_NUMBER)][0xc..], b"0123\0");
    }
}
