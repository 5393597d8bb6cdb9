//! What the computer has and what the rig file's own plan would need of it.

use super::EngineHandle;
use crate::session::plan::{StartRequest, UsedCalibration};
use crate::session::preflight;
use crate::store::memory;
use serde::{Deserialize, Serialize};
use std::path::Path;
use utoipa::ToSchema;

/// The computer that the daemon runs on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ComputerStatus {
    /// What its clock says, RFC 3339.
    pub time: String,
    /// Bytes free on the disk of the data directory, the reserve included; null when the system does not tell.
    pub disk_free_bytes: Option<u64>,
    /// Bytes of them that stay free for journal and shutdown.
    pub disk_reserve_bytes: u64,
    /// Memory that can be had without swapping, bytes; null when the kernel does not tell.
    pub memory_bytes: Option<u64>,
}

/// What a session of the rig file's own plan would need and use.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OwnPlan {
    /// Estimated disk space, bytes, without the reserve.
    pub disk_bytes: u64,
    /// Memory that developing and fitting take at most, bytes.
    pub memory_bytes: u64,
    /// Where lights and camera would come from; null: from the rig file.
    pub calibration: Option<UsedCalibration>,
    /// What to know before shooting: a stale calibration, a lack of memory, a wrong clock.
    pub warnings: Vec<String>,
}

impl EngineHandle {
    /// The computer.
    pub fn computer(&self) -> ComputerStatus {
        let inner = self.book.lock();
        ComputerStatus {
            time: inner.store.clock().now().to_string(),
            disk_free_bytes: inner.store.free_bytes(),
            disk_reserve_bytes: inner.store.reserve_bytes(),
            memory_bytes: memory::available(Path::new("/proc")).ok(),
        }
    }

    /// The rig file's own plan; none where it is refused, as [`EngineHandle::readiness`] says.
    pub fn own_plan(&self) -> Option<OwnPlan> {
        let inner = self.book.lock();
        let (plan, _) = self.planned(&inner, &StartRequest::default()).ok()?;
        let memory_bytes = preflight::memory_bytes(&self.rig, &plan);
        Some(OwnPlan {
            disk_bytes: plan.estimated_bytes,
            memory_bytes,
            calibration: plan.calibration,
            warnings: plan.warnings,
        })
    }
}
