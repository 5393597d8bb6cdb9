//! How people say what a session may leave out.

use crate::session::plan::{Adaptive, LightTargets};
use clap::Args;

/// What a session may leave out of its plan; nothing unless one of these is given.
#[derive(Args, Debug)]
pub struct AdaptiveArgs {
    /// Leave out exposures that would add no information, from the second light station on.
    #[arg(long)]
    adaptive_exposures: bool,
    /// Shoot no more light stations once the error on left-out lights and the standard error of every parameter, both relative, are at
    /// most these: 0.04,0.05.
    #[arg(long, value_name = "LEFT_OUT,PARAMETERS", value_parser = targets)]
    adaptive_lights: Option<LightTargets>,
}

impl AdaptiveArgs {
    /// As a request says it.
    pub fn request(&self) -> Option<Adaptive> {
        let (exposures, lights) = (self.adaptive_exposures, self.adaptive_lights);
        (exposures || lights.is_some()).then_some(Adaptive { exposures, lights })
    }
}

fn targets(text: &str) -> Result<LightTargets, String> {
    let number = |part: &str| part.trim().parse::<f64>().ok().filter(|target| *target > 0.0 && *target <= 1.0);
    text.split_once(',')
        .and_then(|(left_out, parameters)| {
            Some(LightTargets { left_out_error: number(left_out)?, parameter_error: number(parameters)? })
        })
        .ok_or_else(|| "write two numbers above 0 and at most 1 with a comma between them: 0.04,0.05".to_owned())
}
