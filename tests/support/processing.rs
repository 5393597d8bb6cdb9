//! Worker steps of the fakes: they note what they are given and do what a test's scripts say.

use super::Fakes;
use rigd::numerics::fit::solver::Iterate;
use rigd::pipeline::fit::{FitProgress, OnProgress};
use rigd::session::adaptive::Weighed;
use rigd::session::calibration::file::{self, CalibrationFile};
use rigd::session::processing::{Bracket, FitJob, Judged, Next, OpenBracket, Processing, StepJob};
use serde_json::{Value, json};

/// The calibration as the run's own.
fn write_measured(job: &StepJob, found: CalibrationFile) {
    let manifest = &job.manifest;
    let (arm, camera_model, version) = (manifest.arm.clone(), manifest.camera.clone(), manifest.version.unwrap());
    let found = CalibrationFile { id: manifest.id.clone(), version, arm, camera_model, ..found };
    let path = file::path(&job.directory);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, serde_json::to_vec(&found).unwrap()).unwrap();
}

pub struct FakeProcessing(pub Fakes);

impl Processing for FakeProcessing {
    fn least_exposures(&self) -> usize {
        1
    }

    fn develop(&mut self, bracket: &Bracket) -> Result<Value, String> {
        if let Some(reason) = self.0.step_script.lock().unwrap()(&format!("develop {}", bracket.station)) {
            return Err(reason);
        }
        for frame in &bracket.frames {
            let bytes = std::fs::read(bracket.directory.join("frames").join(&frame.file)).unwrap();
            assert_eq!(blake3::hash(&bytes).to_hex().as_str(), frame.blake3);
        }
        self.0.world().developed.push((bracket.station, bracket.frames.len()));
        Ok(Value::Null)
    }

    fn meter(&mut self, bracket: &OpenBracket) -> Result<Next, String> {
        self.0.meter_script.lock().unwrap()(bracket)
    }

    fn weigh(&mut self, job: &FitJob, _: OnProgress<'_>) -> Result<Weighed, String> {
        self.0.weigh_script.lock().unwrap()(job.stations.len())
    }

    fn judge(&mut self, job: &StepJob) -> Result<Judged, String> {
        let name = job.plan.steps[job.step].step.name();
        let shot: usize = job.frames[job.plan.stations_of(job.step)].iter().map(Vec::len).sum();
        self.0.world().judged.push((name.clone(), shot));
        match self.0.step_script.lock().unwrap()(&name) {
            Some(reason) if reason.starts_with("fatal") => Err(reason),
            Some(reason) => Ok(Judged::Refused(reason)),
            None => {
                let measured = self.0.measured.lock().unwrap().clone();
                if let Some(found) = measured.filter(|_| name == "balls") {
                    write_measured(job, found);
                }
                Ok(Judged::Accepted(json!({"frames": shot})))
            }
        }
    }

    fn fit(&mut self, job: &FitJob, progress: OnProgress<'_>) -> Result<Value, String> {
        if let Some(reason) = self.0.step_script.lock().unwrap()("fit") {
            return Err(reason);
        }
        let at = Iterate { iteration: 1, cost: 2.5, rms: 0.5, points: 10, materials: &[] };
        if progress(FitProgress::Iteration(at, &|_| None)).is_break() {
            return Err("the fit was cancelled".into());
        }
        self.0.world().fitted.push(job.stations.len());
        Ok(json!({"mean_relative_error": 0.04, "iterations": 3, "termination": "converged"}))
    }
}
