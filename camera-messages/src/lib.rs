//! What the daemon and its camera worker say to each other, over the worker's stdin and stdout.
//!
//! The worker links libgphoto2, whose calls may never return, so it is a process of its own: one camera, one request at a time,
//! every request with a deadline that the daemon keeps by killing it. A [`frame`] is two lengths, a JSON [`message`] and the bytes
//! of files. [`labels`] makes sense of what a driver offers, [`words`] of what it reports; both need no camera library.

pub mod frame;
pub mod labels;
pub mod message;
pub mod words;
