//! Reading and setting by key. Only these keys are ever written: shutterspeed, aperture, iso, imageformat, capturetarget; other
//! writes have been seen to end in Err 70.

use crate::library::{call, refused};
use camera_messages::message::{Failure, Step};
use gphoto2::Camera;
use gphoto2::widget::{RadioWidget, Widget};

/// The settings of an open camera.
pub(crate) struct Settings<'a>(pub(crate) &'a Camera);

impl Settings<'_> {
    /// What is offered for a key; none if the camera has no choice there.
    pub(crate) fn offered(&self, key: &str) -> Result<Option<Vec<String>>, Failure> {
        Ok(self.radio(key)?.map(|radio| radio.choices_iter().collect()))
    }

    /// The choice that the driver reads back.
    pub(crate) fn choice(&self, key: &str) -> Result<Option<String>, Failure> {
        Ok(self.radio(key)?.map(|radio| radio.choice()))
    }

    /// A text; none if there is none or it is empty.
    pub(crate) fn text(&self, key: &str) -> Result<Option<String>, Failure> {
        let text = match self.widget(key)? {
            Some(Widget::Text(text)) => Some(text.value()),
            Some(Widget::Radio(radio)) => Some(radio.choice()),
            _ => None,
        };
        Ok(text.filter(|text| !text.is_empty() && text != "None"))
    }

    /// Sets a label that is offered. It is sent whatever the driver reads back: that may be its own memory.
    pub(crate) fn set(&self, key: &str, label: &str) -> Result<(), Failure> {
        let radio = self.radio(key)?.ok_or_else(|| refused(Step::Set, format!("the camera offers no {key}")))?;
        radio.set_choice(label).map_err(|error| crate::library::failure(Step::Set, &error))?;
        call(Step::Set, self.0.set_config(&radio))
    }

    fn radio(&self, key: &str) -> Result<Option<RadioWidget>, Failure> {
        Ok(match self.widget(key)? {
            Some(Widget::Radio(radio)) => Some(radio),
            _ => None,
        })
    }

    fn widget(&self, key: &str) -> Result<Option<Widget>, Failure> {
        match call(Step::Read, self.0.config_key::<Widget>(key)) {
            Ok(widget) => Ok(Some(widget)),
            // A key that a camera has not got is a bad parameter to the library.
            Err(failure) if failure.library.as_ref().is_some_and(|error| error.number == -2) => Ok(None),
            Err(failure) => Err(failure),
        }
    }
}
