//! What the file says of the daemon: where it keeps sessions, where it listens, whom it tells.

use schemars::JsonSchema;
use serde::Deserialize;
use std::path::PathBuf;

/// Where sessions are kept.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawStorage {
    /// Directory of all sessions; `--data` wins over it.
    #[schemars(length(min = 1, max = 4096))]
    pub data: PathBuf,
    /// Bytes kept free for journal and shutdown.
    #[serde(default = "default_reserve")]
    #[schemars(range(min = 0, max = 1_000_000_000_000_i64))]
    pub reserve_bytes: u64,
    /// A session that the daemon's end interrupted goes on at its next start; false leaves it for an operator's resume.
    #[serde(default = "default_resume")]
    pub resume_at_start: bool,
    /// A completed session is removed so many days after its end, if `rigd verify` has found it sound as it stands; kept for ever if left
    /// out.
    #[schemars(range(max = 100_000), extend("exclusiveMinimum" = 0))]
    pub keep_days: Option<f64>,
}

fn default_resume() -> bool {
    true
}

fn default_reserve() -> u64 {
    256 << 20
}

/// Where the daemon listens.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct RawServer {
    /// Address and port, `127.0.0.1:7040`; port 0 takes any free one. `--listen` wins over it.
    #[schemars(length(min = 1, max = 100))]
    pub listen: String,
    /// File of tokens, lines of `read TOKEN` or `control TOKEN`; left out, no token is needed, and only loopback is listened on.
    #[schemars(length(min = 1, max = 4096))]
    pub tokens: Option<PathBuf>,
    /// PEM file of the certificate, those that vouch for it after it; with it TLS is spoken and nothing else (builds with `--features tls`).
    #[schemars(length(min = 1, max = 4096))]
    pub certificate: Option<PathBuf>,
    /// PEM file of its private key.
    #[schemars(length(min = 1, max = 4096))]
    pub key: Option<PathBuf>,
}

impl Default for RawServer {
    fn default() -> Self {
        Self { listen: "127.0.0.1:7040".into(), tokens: None, certificate: None, key: None }
    }
}

/// Whom the daemon tells that a session has ended or cannot go on. Without the section nobody is told.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawNotify {
    /// File that holds an address (http://... or https://...) and nothing else: every message is sent there by POST, as JSON.
    #[schemars(length(min = 1, max = 4096))]
    pub webhook_file: Option<PathBuf>,
    /// File that holds the address of an ntfy topic and nothing else.
    #[schemars(length(min = 1, max = 4096))]
    pub ntfy_file: Option<PathBuf>,
    /// E-mail address; messages are handed to the program `sendmail`.
    #[schemars(length(min = 1, max = 254))]
    pub mail_to: Option<String>,
    /// The program that takes e-mail, called with -i and the address.
    #[serde(default = "default_sendmail")]
    #[schemars(length(min = 1, max = 4096))]
    pub sendmail: PathBuf,
}

fn default_sendmail() -> PathBuf {
    "/usr/sbin/sendmail".into()
}
