//! Who is told, and how.

use super::message::Message;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};
use ureq::config::ConfigBuilder;
use ureq::http::Uri;
use ureq::typestate::AgentScope;
use ureq::{Agent, Error};

/// How often a program is looked at that has not ended.
const LOOK: Duration = Duration::from_millis(20);

/// Who is told. Addresses hold secrets: nothing here prints one.
#[derive(Clone)]
pub enum Target {
    /// An address that takes JSON.
    Webhook(Uri),
    /// A topic of ntfy.
    Ntfy(Uri),
    /// An e-mail address, and the program that takes mail.
    Mail {
        /// The address.
        to: String,
        /// The program.
        sendmail: PathBuf,
    },
}

impl Target {
    /// Its kind, for log and metrics.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Webhook(_) => "webhook",
            Self::Ntfy(_) => "ntfy",
            Self::Mail { .. } => "mail",
        }
    }

    /// An address that this build can send to.
    ///
    /// # Errors
    /// In words, without the address.
    pub fn address(text: &str) -> Result<Uri, String> {
        let none = "holds no address: write http://HOST/... or https://HOST/... there, alone";
        let uri: Uri = text.trim().parse().map_err(|_| none.to_owned())?;
        match (uri.scheme_str(), uri.host()) {
            (Some("https"), Some(_)) if !cfg!(feature = "tls") => {
                Err("holds an https address, and this rigd was built without `--features tls`".into())
            }
            (Some("http" | "https"), Some(_)) => Ok(uri),
            _ => Err(none.into()),
        }
    }

    /// Hands the message over; gives up after `limit`.
    ///
    /// # Errors
    /// In words, without the address.
    pub fn send(&self, message: &Message, limit: Duration) -> Result<(), String> {
        match self {
            Self::Webhook(uri) => {
                let body = serde_json::to_vec(message).map_err(|e| e.to_string())?;
                post(uri, limit, &[("Content-Type", "application/json")], &body)
            }
            Self::Ntfy(uri) => {
                let priority = if message.event.is_urgent() { "high" } else { "default" };
                post(uri, limit, &[("Title", message.title), ("Priority", priority)], message.text.as_bytes())
            }
            Self::Mail { to, sendmail } => mail(sendmail, to, &message.mail(to), limit),
        }
    }
}

/// A client that trusts whom the system trusts (`SSL_CERT_FILE` names others), in builds with the feature `tls`.
pub fn trusting(config: ConfigBuilder<AgentScope>) -> ConfigBuilder<AgentScope> {
    #[cfg(feature = "tls")]
    let config = {
        use ureq::tls::{RootCerts, TlsConfig};
        config.tls_config(TlsConfig::builder().root_certs(RootCerts::PlatformVerifier).build())
    };
    config
}

fn post(uri: &Uri, limit: Duration, headers: &[(&str, &str)], body: &[u8]) -> Result<(), String> {
    let config = Agent::config_builder()
        .http_status_as_error(false)
        .max_redirects(0)
        .max_redirects_will_error(false)
        .proxy(None)
        .timeout_global(Some(limit));
    let mut request = trusting(config).build().new_agent().post(uri);
    for (name, value) in headers {
        request = request.header(*name, *value);
    }
    let status = request.send(body).map_err(told)?.status();
    if status.is_success() { Ok(()) } else { Err(format!("it answered with status {}", status.as_u16())) }
}

/// What went wrong; words of the client that may repeat the address are left out.
fn told(error: Error) -> String {
    match error {
        Error::Timeout(_) => "it did not answer in time".into(),
        Error::HostNotFound => "there is no such host".into(),
        Error::Io(error) => error.to_string(),
        #[cfg(feature = "tls")]
        Error::Rustls(error) => format!("TLS: {error}"),
        _ => "it did not answer as HTTP servers do".into(),
    }
}

fn mail(program: &Path, to: &str, text: &str, limit: Duration) -> Result<(), String> {
    let mut command = Command::new(program);
    command.args(["-i", to]).stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
    let mut child = command.spawn().map_err(|e| format!("the mail program cannot be started: {e}"))?;
    let end = Instant::now() + limit;
    // The whole text fits the pipe: a program that does not read holds nobody up.
    let written = child.stdin.take().map_or(Ok(()), |mut pipe| pipe.write_all(text.as_bytes()));
    loop {
        match child.try_wait() {
            Ok(Some(status)) if status.success() => return written.map_err(|e| format!("the mail program: {e}")),
            Ok(Some(status)) => return Err(format!("the mail program ended with {status}")),
            Ok(None) if Instant::now() < end => thread::sleep(LOOK),
            Ok(None) => break,
            Err(error) => return Err(format!("the mail program: {error}")),
        }
    }
    let _ = child.kill();
    let _ = child.wait();
    Err("the mail program did not end in time".into())
}
