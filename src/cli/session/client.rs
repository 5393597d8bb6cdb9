//! The daemon's REST surface as calls.

use super::failure::ClientError;
use crate::notify::trusting;
use crate::session::handle::{
    CalibrationRequest, CalibrationSnapshot, QueueRequest, QueueSnapshot, QueuedSession, SessionSnapshot,
};
use crate::session::plan::{CapturePlan, StartRequest};
use crate::session::state::Verb;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::io::{BufRead, BufReader, Read};
use std::time::Duration;
use ureq::http::{Response, Uri};
use ureq::typestate::{WithBody, WithoutBody};
use ureq::{Agent, Body, RequestBuilder};

/// Longest time the daemon may take to answer.
const ANSWER: Duration = Duration::from_secs(30);
/// Longest silence of an event stream: the daemon says something every 15 s.
const SILENCE: Duration = Duration::from_secs(45);

/// Calls one daemon.
pub struct Client {
    base: String,
    agent: Agent,
    /// Value of the header that shows the token.
    authorization: Option<String>,
}

#[derive(Deserialize)]
struct CalibrationList {
    calibrations: Vec<CalibrationSnapshot>,
}

#[derive(Deserialize)]
struct FrameList {
    frames: Vec<Frame>,
}

/// A frame of a session, as far as people want to see it; the rest is kept.
#[derive(Debug, Deserialize, Serialize)]
pub struct Frame {
    /// Station, from 0.
    pub station: usize,
    /// Exposure of the bracket, from 0.
    pub exposure: usize,
    /// File in `frames/` of the session's directory.
    pub file: String,
    /// Label of the shutter time.
    pub shutter: String,
    /// Size of the file.
    pub bytes: u64,
    /// `committed`, or `superseded` by a later attempt.
    pub state: String,
    /// What else the daemon says of it.
    #[serde(flatten)]
    pub more: serde_json::Map<String, serde_json::Value>,
}

fn check_id(id: &str, what: &str) -> Result<(), ClientError> {
    if id.is_empty() || !id.chars().all(|c| c.is_ascii_alphanumeric() || c == '-') {
        return Err(ClientError::Usage(format!("`{id}` is no {what}")));
    }
    Ok(())
}

#[derive(Deserialize)]
struct SessionPage {
    sessions: Vec<SessionSnapshot>,
    next_page_token: Option<String>,
}

impl Client {
    /// A client of the daemon at `base_url`, `http://ADDRESS:PORT` or https, that shows it `token`.
    ///
    /// # Errors
    /// `base_url` is no such address.
    pub fn new(base_url: &str, token: Option<&str>) -> Result<Self, ClientError> {
        let base = base_url.trim_end_matches('/').to_owned();
        let uri = base.parse::<Uri>().ok().filter(|uri| uri.host().is_some());
        let scheme = uri.as_ref().and_then(Uri::scheme_str);
        if scheme == Some("https") && !cfg!(feature = "tls") {
            return Err(ClientError::Usage(format!("{base_url}: this rigd was built without `--features tls`")));
        }
        if !matches!(scheme, Some("http" | "https")) {
            return Err(ClientError::Usage(format!(
                "`{base_url}` is no daemon's address: write http://127.0.0.1:PORT"
            )));
        }
        // The daemon is on this machine: a proxy from the environment could not reach it.
        let config = Agent::config_builder()
            .http_status_as_error(false)
            .proxy(None)
            .timeout_connect(Some(ANSWER))
            .timeout_recv_response(Some(ANSWER))
            .timeout_per_read(Some(SILENCE));
        let authorization = token.map(|token| format!("Bearer {token}"));
        Ok(Self { base, agent: trusting(config).build().new_agent(), authorization })
    }

    fn get(&self, url: impl AsRef<str>) -> RequestBuilder<WithoutBody> {
        self.with_token(self.agent.get(url.as_ref()))
    }

    fn post(&self, url: impl AsRef<str>) -> RequestBuilder<WithBody> {
        self.with_token(self.agent.post(url.as_ref()))
    }

    fn delete(&self, url: impl AsRef<str>) -> RequestBuilder<WithoutBody> {
        self.with_token(self.agent.delete(url.as_ref()))
    }

    fn with_token<B>(&self, request: RequestBuilder<B>) -> RequestBuilder<B> {
        match &self.authorization {
            Some(value) => request.header("Authorization", value),
            None => request,
        }
    }

    /// The plan a request would run; nothing moves.
    ///
    /// # Errors
    /// As for every call: no connection, a refusal, or a foreign answer.
    pub fn plan(&self, request: &StartRequest) -> Result<CapturePlan, ClientError> {
        let url = format!("{}/v1/sessions?dry_run=true", self.base);
        self.read(self.post(url).send_json(request))
    }

    /// Starts a session.
    ///
    /// # Errors
    /// As for [`Client::plan`].
    pub fn start(&self, request: &StartRequest) -> Result<SessionSnapshot, ClientError> {
        self.read(self.post(format!("{}/v1/sessions", self.base)).send_json(request))
    }

    /// Every session, newest first.
    ///
    /// # Errors
    /// As for [`Client::plan`].
    pub fn list(&self) -> Result<Vec<SessionSnapshot>, ClientError> {
        let (mut all, mut query) = (Vec::new(), String::new());
        loop {
            let page: SessionPage = self.read(self.get(format!("{}/v1/sessions{query}", self.base)).call())?;
            all.extend(page.sessions);
            match page.next_page_token {
                Some(token) => query = format!("?page_token={token}"),
                None => return Ok(all),
            }
        }
    }

    /// One session.
    ///
    /// # Errors
    /// As for [`Client::plan`].
    pub fn session(&self, id: &str) -> Result<SessionSnapshot, ClientError> {
        self.read(self.get(self.of_session(id, "")?).call())
    }

    /// Every frame of a session: `station`, `exposure`, `file`, `blake3`, `bytes`, `shutter`, `state`.
    ///
    /// # Errors
    /// As for [`Client::plan`].
    pub fn frames(&self, id: &str) -> Result<Vec<Frame>, ClientError> {
        let list: FrameList = self.read(self.get(self.of_session(id, "/frames")?).call())?;
        Ok(list.frames)
    }

    /// Material and report of a completed session.
    ///
    /// # Errors
    /// As for [`Client::plan`].
    pub fn material(&self, id: &str) -> Result<serde_json::Value, ClientError> {
        self.read(self.get(self.of_session(id, "/material")?).call())
    }

    /// Asks something of a session.
    ///
    /// # Errors
    /// As for [`Client::plan`].
    pub fn command(&self, id: &str, verb: Verb) -> Result<SessionSnapshot, ClientError> {
        let url = self.of_session(id, &format!("/{verb}"))?;
        self.read(self.post(url).send_empty())
    }

    /// Starts a calibration.
    ///
    /// # Errors
    /// As for [`Client::plan`].
    pub fn start_calibration(&self, request: &CalibrationRequest) -> Result<CalibrationSnapshot, ClientError> {
        self.read(self.post(format!("{}/v1/calibrations", self.base)).send_json(request))
    }

    /// Every calibration, newest first.
    ///
    /// # Errors
    /// As for [`Client::plan`].
    pub fn calibrations(&self) -> Result<Vec<CalibrationSnapshot>, ClientError> {
        let list: CalibrationList = self.read(self.get(format!("{}/v1/calibrations", self.base)).call())?;
        Ok(list.calibrations)
    }

    /// One calibration.
    ///
    /// # Errors
    /// As for [`Client::plan`].
    pub fn calibration(&self, id: &str) -> Result<CalibrationSnapshot, ClientError> {
        self.read(self.get(self.of_calibration(id, "")?).call())
    }

    /// What a completed calibration measured.
    ///
    /// # Errors
    /// As for [`Client::plan`].
    pub fn calibration_result(&self, id: &str) -> Result<serde_json::Value, ClientError> {
        self.read(self.get(self.of_calibration(id, "/result")?).call())
    }

    /// Asks a calibration to shoot or to abort.
    ///
    /// # Errors
    /// As for [`Client::plan`].
    pub fn command_calibration(&self, id: &str, verb: Verb) -> Result<CalibrationSnapshot, ClientError> {
        let url = self.of_calibration(id, &format!("/{verb}"))?;
        self.read(self.post(url).send_empty())
    }

    /// The queue.
    ///
    /// # Errors
    /// As for [`Client::plan`].
    pub fn queue(&self) -> Result<QueueSnapshot, ClientError> {
        self.read(self.get(format!("{}/v1/queue", self.base)).call())
    }

    /// Puts a session at the end of the queue.
    ///
    /// # Errors
    /// As for [`Client::plan`].
    pub fn enqueue(&self, request: &QueueRequest) -> Result<QueuedSession, ClientError> {
        self.read(self.post(format!("{}/v1/queue", self.base)).send_json(request))
    }

    /// Takes an entry out of the queue.
    ///
    /// # Errors
    /// As for [`Client::plan`].
    pub fn dequeue(&self, id: &str) -> Result<(), ClientError> {
        check_id(id, "entry of the queue: see `rigd queue list`")?;
        self.accepted(self.delete(format!("{}/v1/queue/{id}", self.base)).call()).map(|_| ())
    }

    /// Makes an entry the next one.
    ///
    /// # Errors
    /// As for [`Client::plan`].
    pub fn queue_first(&self, id: &str) -> Result<QueueSnapshot, ClientError> {
        check_id(id, "entry of the queue: see `rigd queue list`")?;
        self.read(self.post(format!("{}/v1/queue/{id}/first", self.base)).send_empty())
    }

    /// Holds the queue, or lets it go on.
    ///
    /// # Errors
    /// As for [`Client::plan`].
    pub fn hold_queue(&self, held: bool) -> Result<QueueSnapshot, ClientError> {
        let verb = if held { "hold" } else { "release" };
        self.read(self.post(format!("{}/v1/queue/{verb}", self.base)).send_empty())
    }

    /// Sequence numbers of a session's events above `after`, as they come, until the stream ends or breaks.
    pub(super) fn events(&self, id: &str, after: u64) -> Result<impl Iterator<Item = u64> + use<>, ClientError> {
        let request = self.get(self.of_session(id, "/events")?).header("Last-Event-ID", after.to_string());
        let body = self.accepted(request.call())?.into_body().into_reader();
        Ok(ids(body))
    }

    /// Path of a session; ids that would change the path are refused here.
    fn of_session(&self, id: &str, rest: &str) -> Result<String, ClientError> {
        check_id(id, "session id: see `rigd session list`")?;
        Ok(format!("{}/v1/sessions/{id}{rest}", self.base))
    }

    fn of_calibration(&self, id: &str, rest: &str) -> Result<String, ClientError> {
        check_id(id, "calibration id: see `rigd calibrate list`")?;
        Ok(format!("{}/v1/calibrations/{id}{rest}", self.base))
    }

    fn read<T: DeserializeOwned>(&self, answer: Result<Response<Body>, ureq::Error>) -> Result<T, ClientError> {
        let mut response = self.accepted(answer)?;
        response.body_mut().read_json().map_err(|e| self.foreign(e))
    }

    /// The answer if it is a success, its problem if not.
    fn accepted(&self, answer: Result<Response<Body>, ureq::Error>) -> Result<Response<Body>, ClientError> {
        let mut response =
            answer.map_err(|e| ClientError::Unreachable { base: self.base.clone(), source: Box::new(e) })?;
        if response.status().is_success() {
            return Ok(response);
        }
        let problem =
            response.body_mut().read_json().map_err(|_| self.foreign(format!("status {}", response.status())))?;
        Err(ClientError::Refused(Box::new(problem)))
    }

    fn foreign(&self, what: impl ToString) -> ClientError {
        ClientError::Foreign { base: self.base.clone(), what: what.to_string() }
    }
}

/// The ids of a server-sent event stream, each once its event is complete.
fn ids(stream: impl Read) -> impl Iterator<Item = u64> {
    let mut pending = None;
    let lines = BufReader::new(stream).lines().map_while(Result::ok);
    lines.filter_map(move |line| {
        if let Some(id) = line.strip_prefix("id:") {
            pending = id.trim().parse().ok();
        }
        if line.is_empty() { pending.take() } else { None }
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn ids_are_given_once_their_event_is_complete() {
        let stream = "id: 4\nevent: a\ndata: {}\n\n: keep-alive\n\nid:5\ndata: {}\n\nid: 6\ndata: cut off";
        assert_eq!(ids(stream.as_bytes()).collect::<Vec<_>>(), [4, 5]);
    }

    #[test]
    fn addresses_and_ids_that_cannot_be_are_bad_usage() {
        for bad in ["", "127.0.0.1:7040", "ftp://127.0.0.1", "http://", "https://127.0.0.1", "http://a b"] {
            let error = Client::new(bad, None).err().unwrap();
            assert!(error.is_bad_input(), "{bad}");
        }
        let client = Client::new("http://127.0.0.1:1/", None).unwrap();
        for bad in ["", "../rig", "a?b", "a/b", "a#b", "%2e"] {
            assert!(client.session(bad).unwrap_err().is_bad_input(), "{bad}");
        }
    }

    #[test]
    fn a_daemon_that_is_not_there_is_a_failure_not_bad_usage() {
        // A port that was free a moment ago and that nobody listens on.
        let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let error = Client::new(&format!("http://127.0.0.1:{port}"), None).unwrap().list().unwrap_err();
        assert!(!error.is_bad_input());
        assert!(error.to_string().contains("is the daemon running"), "{error}");
    }
}
