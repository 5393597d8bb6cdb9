//! What waits for its turn: sessions in the queue, and refits.

use super::Inner;
use crate::session::queue::Queue;
use crate::store::StoreError;

impl Inner {
    /// A refit of this session is over.
    pub fn refitted(&mut self, id: &str) {
        if let Some(at) = self.refits.iter().position(|refit| refit == id) {
            self.refits.remove(at);
        }
    }

    /// Changes the queue; a change that cannot be written is not made.
    pub fn change_queue(&mut self, change: impl FnOnce(&mut Queue)) -> Result<(), StoreError> {
        let mut queue = self.queue.clone();
        change(&mut queue);
        queue.write(&self.store)?;
        self.queue = queue;
        Ok(())
    }
}
