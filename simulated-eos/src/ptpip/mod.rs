//! PTP over TCP/IP (CIPA DC-005): packets, and the server that puts a body on a port.

mod connection;
mod packet;
mod server;

pub use server::Server;
