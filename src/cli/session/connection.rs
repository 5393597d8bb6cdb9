//! Which daemon a command asks, and with which token.

use super::Client;
use crate::cli::error::bad_input;
use crate::http::is_token;
use crate::store::files::shown;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Which daemon, and the token it wants.
#[derive(Clone, Debug, clap::Args)]
pub struct Connection {
    /// Where the daemon listens.
    #[arg(long, global = true, default_value = "http://127.0.0.1:7040")]
    url: String,
    /// File that holds the daemon's token and nothing else; without it, the token is taken from RIGD_TOKEN, if that is set.
    #[arg(long, global = true, value_name = "FILE")]
    token_file: Option<PathBuf>,
}

impl Connection {
    /// A client of that daemon.
    ///
    /// # Errors
    /// No address, or no token where one is said to be; never with what is there instead.
    pub fn client(&self) -> anyhow::Result<Client> {
        let token = match &self.token_file {
            Some(path) => Some(read(path).map_err(|what| bad_input(format!("{}: {what}", shown(path))))?),
            None => match std::env::var_os("RIGD_TOKEN") {
                Some(text) => Some(text.into_string().ok().and_then(|text| token(&text)).ok_or_else(|| {
                    bad_input("RIGD_TOKEN holds no token: set it to 32 to 512 letters, digits or -._~+/=")
                })?),
                None => None,
            },
        };
        Ok(Client::new(&self.url, token.as_deref())?)
    }
}

fn read(path: &Path) -> Result<String, String> {
    let mut text = String::new();
    let file = File::open(path).map_err(|e| format!("cannot be opened: {e}"))?;
    file.take(4096).read_to_string(&mut text).map_err(|e| format!("cannot be read: {e}"))?;
    token(&text).ok_or_else(|| "holds no token: write it there alone, 32 to 512 letters, digits or -._~+/=".into())
}

fn token(text: &str) -> Option<String> {
    Some(text.trim()).filter(|text| is_token(text)).map(str::to_owned)
}
