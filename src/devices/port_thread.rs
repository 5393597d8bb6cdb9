//! The thread that owns an arm's port: one job at a time, and a look at the device whenever nobody asks, so that its dead-man stays fed
//! through an exposure of any length, and a restart in it is heard.

use super::arm::ArmError;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread;
use std::time::Duration;

/// Silence after which the thread looks at the device by itself: grbl's manual advises at most five looks a second.
const FEED_PERIOD: Duration = Duration::from_millis(250);
/// Longest wait for the thread to make the device safe and close the port.
const END_LIMIT: Duration = Duration::from_secs(3);

/// What has the port and speaks the device's language.
pub(super) trait PortOwner: Send + 'static {
    /// Asks the device for its status.
    fn feed(&mut self) -> Result<(), ArmError>;
    /// Motor stopped, lamp off, as far as the device still listens: called on every way out.
    fn make_safe(&mut self);
}

/// Work for the thread, with what went wrong while nobody asked.
type Job<O> = Box<dyn FnOnce(&mut O, Option<ArmError>) + Send>;

/// Handle on the thread. Dropping it makes the device safe and closes the port.
pub(super) struct PortThread<O> {
    inbox: Option<SyncSender<Job<O>>>,
    ended: Receiver<()>,
}

impl<O: PortOwner> PortThread<O> {
    /// Gives `owner` a thread.
    pub fn spawn(mut owner: O) -> Result<Self, ArmError> {
        let (inbox, jobs) = sync_channel(1);
        let (end, ended) = sync_channel::<()>(1);
        let run = move || {
            serve(&mut owner, &jobs);
            owner.make_safe();
            drop(owner);
            drop(end);
        };
        thread::Builder::new().name("arm".into()).spawn(run).map_err(|_| ArmError::Gone)?;
        Ok(Self { inbox: Some(inbox), ended })
    }

    /// Runs `work` on the thread, or tells what went wrong while nobody asked. Returns within `limit`, whatever happens.
    pub fn with<T: Send + 'static>(
        &self,
        limit: Duration,
        work: impl FnOnce(&mut O) -> Result<T, ArmError> + Send + 'static,
    ) -> Result<T, ArmError> {
        let inbox = self.inbox.as_ref().ok_or(ArmError::Gone)?;
        let (reply, answer) = sync_channel(1);
        let job = move |owner: &mut O, unheard: Option<ArmError>| {
            let _ = reply.send(unheard.map_or_else(|| work(owner), Err));
        };
        // Full means that the thread still hangs in a call that was given up.
        inbox.try_send(Box::new(job)).map_err(|_| ArmError::Gone)?;
        answer.recv_timeout(limit).unwrap_or(Err(ArmError::Gone))
    }
}

impl<O> Drop for PortThread<O> {
    fn drop(&mut self) {
        self.inbox = None;
        let _ = self.ended.recv_timeout(END_LIMIT);
    }
}

fn serve<O: PortOwner>(owner: &mut O, jobs: &Receiver<Job<O>>) {
    let mut unheard = None;
    loop {
        match jobs.recv_timeout(FEED_PERIOD) {
            Ok(job) => job(owner, unheard.take()),
            Err(RecvTimeoutError::Disconnected) => return,
            Err(RecvTimeoutError::Timeout) => match owner.feed() {
                // A silent device is found again by the next who asks, and a lost port stays lost. Only the rest would be forgotten.
                Ok(()) | Err(ArmError::Port { .. } | ArmError::NoAnswer { .. }) => {}
                Err(error) => unheard = Some(error),
            },
        }
    }
}
