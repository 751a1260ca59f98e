//! Serves the page and the events on this computer, and takes commands.
//!
//! Events and commands need the token, which is in the fragment of the URL that is printed: browsers never
//! send the fragment. A command also needs the page's own origin, and every request a known host name, so
//! that no other page in the same browser gets anything or has anything done.

use std::{
    convert::Infallible,
    io::{self, ErrorKind},
    net::{IpAddr, SocketAddr, TcpListener},
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        mpsc::{self, Receiver},
    },
    thread,
    time::Duration,
};

use axum::{
    Json, Router,
    extract::{Query, Request, State, rejection::JsonRejection},
    http::{
        HeaderMap, HeaderName, HeaderValue, Method, StatusCode,
        header::{CONTENT_TYPE, HOST, ORIGIN},
    },
    middleware::{self, Next},
    response::{
        IntoResponse, Response,
        sse::{self, KeepAlive, Sse},
    },
    routing::{get, post},
};
use results::record::event::Event;
use serde::{Deserialize, Deserializer, Serialize};
use tokio::sync::{mpsc as channel, watch};
use tokio_stream::wrappers::ReceiverStream;
use tracing::{field::display, info, warn};

use super::{
    Asked, EditError, Editing, Log, STYLE,
    connections::{self, Connection, Limits},
    editor_page, editor_script, page, script,
};
use crate::logging::Throttle;

/// Command of a user at the page.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
pub enum Command {
    /// Time stands still; simulations only, as the next ones.
    Pause,
    /// Time goes on.
    Resume,
    /// A simulation runs at so many times real time; 0 for as fast as possible.
    Speed {
        /// Number of times.
        #[serde(deserialize_with = "number")]
        times: f64,
    },
    /// A node restarts.
    Restart {
        /// Number of the node.
        node: u16,
    },
    /// A camera is unplugged for a while.
    Unplug {
        /// Number of the camera's node.
        node: u16,
        /// Duration of the unplugging.
        #[serde(deserialize_with = "number")]
        seconds: f64,
    },
    /// A carrier covers all channels.
    Jam {
        /// Duration of the jamming.
        #[serde(deserialize_with = "number")]
        seconds: f64,
    },
    /// A target's step sensor adds an error to each distance.
    Drift {
        /// Number of the target.
        node: u16,
        /// Duration of the error.
        #[serde(deserialize_with = "number")]
        seconds: f64,
        /// Error as a share of the distance.
        #[serde(deserialize_with = "number")]
        share: f64,
    },
    /// A camera is moved.
    Move {
        /// Number of the camera.
        node: u16,
        /// Displacement.
        #[serde(deserialize_with = "numbers")]
        by: [f64; 2],
        /// Turn, degrees counter-clockwise.
        #[serde(deserialize_with = "number")]
        turn_deg: f64,
    },
    /// New nodes may join.
    JoinWindow {
        /// Time for it, seconds; 0 closes the window.
        seconds: u16,
    },
    /// A node is sent away.
    Remove {
        /// Number of the node.
        node: u16,
    },
    /// A camera, or every camera, does something.
    Camera {
        /// Number of the camera; all cameras if `None`.
        node: Option<u16>,
        /// The command as on the command line of `host-sim console`.
        command: String,
    },
}

/// Takes a fraction also where a build of `serde_json` keeps the digits of numbers (its feature `arbitrary_precision`):
/// fields of an enum with a tag are buffered, and there such a number is a map.
fn number<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    as_f64(&serde_json::Number::deserialize(from)?)
}

/// Takes several [`number`]s.
fn numbers<'de, D: Deserializer<'de>>(from: D) -> Result<[f64; 2], D::Error> {
    let [x, y] = <[serde_json::Number; 2]>::deserialize(from)?;
    Ok([as_f64(&x)?, as_f64(&y)?])
}

fn as_f64<E: serde::de::Error>(number: &serde_json::Number) -> Result<f64, E> {
    number
        .as_f64()
        .ok_or_else(|| E::custom(format_args!("{number} is too large")))
}

/// Facts about the server that the page needs.
#[derive(Clone, Debug, Serialize)]
pub struct About {
    /// Name of the network or site that is shown.
    pub name: String,
    /// `simulation`, `network` or `recorded`: decides which commands there are.
    pub kind: &'static str,
    /// Speed with which a simulation begins, times real time; 0 for as fast as possible.
    pub speed: f64,
}

/// Reason why the page cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// The address cannot be used.
    #[error("{0} cannot be served: {why}", why = no_address(.0, .1))]
    Bind(SocketAddr, io::Error),
    /// The machine gives no random numbers.
    #[error("there is no randomness for a token")]
    Random,
    /// The machine does not let it run.
    #[error("the server cannot run: {0}")]
    Run(io::Error),
}

/// Reason why an address cannot be had, and what to do.
fn no_address(address: &SocketAddr, error: &io::Error) -> String {
    match error.kind() {
        ErrorKind::AddrNotAvailable => format!(
            "this computer does not have the address {}: give one of its own to --listen, or 0.0.0.0 for all of them",
            address.ip()
        ),
        ErrorKind::AddrInUse => format!(
            "another program serves on port {}: end it, or give another --http-port (0 takes a free one)",
            address.port()
        ),
        ErrorKind::PermissionDenied => format!(
            "you may not serve on port {}: give an --http-port from 1024 on (0 takes a free one)",
            address.port()
        ),
        _ => error.to_string(),
    }
}

/// A server that runs; takes events.
#[derive(Clone)]
pub struct Server(Arc<Shared>);

struct Shared {
    about: About,
    log: Mutex<Log>,
    news: watch::Sender<u64>,
    commands: Mutex<mpsc::Sender<Command>>,
    token: String,
    address: SocketAddr,
    /// Identifies the run, so that the events of another run are not taken for those that follow.
    run: String,
    /// A site to edit, in place of events.
    editing: Option<Editing>,
    /// Requests that were refused for want of the token, and of the host's name.
    strangers: Throttle,
    misdirected: Throttle,
}

fn random_hex<const N: usize>() -> Result<String, ServerError> {
    let mut bytes = [0; N];
    getrandom::fill(&mut bytes).map_err(|_| ServerError::Random)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Serves from now on, on a thread of its own, as long as the program runs. Returns the commands too.
///
/// # Errors
/// [`ServerError`]
pub fn serve(
    address: SocketAddr,
    about: About,
) -> Result<(Server, Receiver<Command>), ServerError> {
    start(address, about, None, Limits::default())
}

/// Serves the page on which people edit a site from now on, as [`serve`].
///
/// # Errors
/// [`ServerError`]
pub fn serve_editor(
    address: SocketAddr,
    name: String,
    editing: Editing,
) -> Result<Server, ServerError> {
    let kind = "site";
    let speed = 0.0;
    let about = About { name, kind, speed };
    start(address, about, Some(editing), Limits::default()).map(|(server, _)| server)
}

pub(super) fn start(
    address: SocketAddr,
    about: About,
    editing: Option<Editing>,
    limits: Limits,
) -> Result<(Server, Receiver<Command>), ServerError> {
    let failed = |error| ServerError::Bind(address, error);
    let listener = TcpListener::bind(address).map_err(failed)?;
    listener.set_nonblocking(true).map_err(failed)?;
    let (sender, receiver) = mpsc::channel();
    let server = Server(Arc::new(Shared {
        about,
        log: Mutex::default(),
        news: watch::channel(0).0,
        commands: Mutex::new(sender),
        token: random_hex::<16>()?,
        address: listener.local_addr().map_err(failed)?,
        run: random_hex::<4>()?,
        editing,
        strangers: Throttle::default(),
        misdirected: Throttle::default(),
    }));
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(ServerError::Run)?;
    let router = router(server.clone());
    thread::spawn(move || {
        runtime.block_on(async {
            if let Ok(listener) = tokio::net::TcpListener::from_std(listener) {
                connections::serve(listener, router, limits).await;
            }
        });
    });
    Ok((server, receiver))
}

impl Server {
    /// URL at which the user looks, with the token.
    pub fn url(&self) -> String {
        let Shared { address, token, .. } = &*self.0;
        format!("http://{address}/#{token}")
    }

    /// Tells all pages.
    pub fn tell(&self, events: impl IntoIterator<Item = Event>) {
        let mut log = self.log();
        for event in events {
            log.push(event);
        }
        self.0.news.send_replace(log.next());
    }

    /// The events from a number on as JSON, each with the number after it.
    fn lines(&self, from: Option<u64>) -> Vec<(u64, String)> {
        let log = self.log();
        let events = log.since(from).into_iter();
        events
            .filter_map(|(number, event)| Some((number, serde_json::to_string(event).ok()?)))
            .collect()
    }

    fn log(&self) -> MutexGuard<'_, Log> {
        self.0.log.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_token(&self, given: &str) -> bool {
        let own = self.0.token.as_bytes();
        // The time tells nothing of where they differ.
        let differ = own
            .iter()
            .zip(given.as_bytes())
            .fold(0, |all, (a, b)| all | (a ^ b));
        own.len() == given.len() && differ == 0
    }

    /// Returns true if a request is from the page that this server sent, opened with the token.
    fn is_own_page(&self, headers: &HeaderMap) -> bool {
        let text = |name: HeaderName| headers.get(name).and_then(|value| value.to_str().ok());
        let host = text(HOST).unwrap_or_default();
        let is_own = text(ORIGIN) == Some(format!("http://{host}").as_str());
        let token = text(HeaderName::from_static("x-token")).unwrap_or_default();
        is_own && self.is_token(token)
    }

    /// Returns true if a request names this server as its own page does.
    fn is_host(&self, host: &str) -> bool {
        let address = self.0.address;
        let is_own = host == address.to_string();
        let is_local =
            address.ip().is_loopback() && host == format!("localhost:{}", address.port());
        // If it serves on all addresses, any address may be its own; but a name could belong to any computer.
        let is_any = address.ip().is_unspecified()
            && host
                .parse::<SocketAddr>()
                .is_ok_and(|named| named.port() == address.port());
        let is_default = address.port() == 80 && host.parse::<IpAddr>().is_ok();
        is_own || is_local || is_any || is_default
    }
}

const HTML: &str = "text/html; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

fn router(server: Server) -> Router {
    let of = |kind: &'static str, text: fn() -> String| {
        get(move || async move { ([(CONTENT_TYPE, kind)], text()) })
    };
    let (html, app, owners) = match &server.0.editing {
        Some(_) => {
            let owners = Router::new()
                .route("/site", get(site))
                .route("/design", post(design))
                .route("/save", post(save));
            (of(HTML, editor_page), of(SCRIPT, editor_script), owners)
        }
        None => {
            let owners = Router::new()
                .route("/events", get(events))
                .route("/command", post(command));
            (of(HTML, page), of(SCRIPT, script), owners)
        }
    };
    owners
        .route("/about", get(about))
        .route_layer(middleware::from_fn_with_state(server.clone(), owners_only))
        .route("/", html)
        .route("/app.js", app)
        .route(
            "/style.css",
            of("text/css; charset=utf-8", || STYLE.to_owned()),
        )
        .layer(middleware::from_fn_with_state(server.clone(), guard))
        .with_state(server)
}

/// Refuses requests without the token before any of their body is read, and commands from other pages.
async fn owners_only(State(server): State<Server>, request: Request, next: Next) -> Response {
    let given = Query::<Token>::try_from_uri(request.uri());
    let is_owners = match *request.method() {
        Method::GET => given.is_ok_and(|Query(given)| server.is_token(&given.token)),
        _ => server.is_own_page(request.headers()),
    };
    let connection = request.extensions().get::<Connection>();
    if !is_owners {
        if let Some(count) = server.0.strangers.count(1) {
            let peer = connection.map(|own| display(own.peer));
            warn!(peer, count, "a request without the token is refused");
        }
        return StatusCode::FORBIDDEN.into_response();
    }
    if let Some(connection) = connection {
        connection.is_owners();
    }
    next.run(request).await
}

/// Refuses requests under other names, to which another site may have led the browser, and tells browsers
/// to run only the page's own parts.
async fn guard(State(server): State<Server>, request: Request, next: Next) -> Response {
    let host = request
        .headers()
        .get(HOST)
        .and_then(|host| host.to_str().ok());
    let mut response = if host.is_some_and(|host| server.is_host(host)) {
        next.run(request).await
    } else {
        if let Some(count) = server.0.misdirected.count(1) {
            let connection = request.extensions().get::<Connection>();
            let peer = connection.map(|own| display(own.peer));
            warn!(peer, count, "a request for another host is refused");
        }
        StatusCode::MISDIRECTED_REQUEST.into_response()
    };
    let headers = response.headers_mut();
    for (name, value) in [
        (
            "content-security-policy",
            "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src data:; \
             base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
        ),
        ("x-content-type-options", "nosniff"),
        ("referrer-policy", "no-referrer"),
        ("cross-origin-resource-policy", "same-origin"),
        ("cache-control", "no-store"),
    ] {
        headers.insert(
            HeaderName::from_static(name),
            HeaderValue::from_static(value),
        );
    }
    response
}

#[derive(Deserialize)]
struct Token {
    #[serde(default)]
    token: String,
}

async fn about(State(server): State<Server>) -> Json<About> {
    Json(server.0.about.clone())
}

/// Sends all events, and then those that come.
async fn events(State(server): State<Server>, headers: HeaderMap) -> Response {
    let last = headers.get("last-event-id").and_then(|id| id.to_str().ok());
    let own = last.and_then(|id| id.strip_prefix(server.0.run.as_str())?.strip_prefix('-'));
    let mut from: Option<u64> = own.and_then(|number| number.parse().ok());
    let (sender, receiver) = channel::channel::<Result<sse::Event, Infallible>>(64);
    tokio::spawn(async move {
        let mut news = server.0.news.subscribe();
        loop {
            news.borrow_and_update();
            if from.is_some_and(|number| !server.log().has(number)) {
                info!("a page gets the record anew: it was slow, or away");
            }
            let lines = server.lines(from);
            for (number, line) in lines {
                let id = format!("{}-{number}", server.0.run);
                let event = sse::Event::default().id(id).data(line);
                if sender.send(Ok(event)).await.is_err() {
                    return;
                }
                from = Some(number);
            }
            tokio::select! {
                changed = news.changed() => if changed.is_err() { return },
                () = sender.closed() => return,
            }
        }
    });
    let alive = KeepAlive::new().interval(Duration::from_secs(5));
    Sse::new(ReceiverStream::new(receiver))
        .keep_alive(alive)
        .into_response()
}

async fn command(
    State(server): State<Server>,
    command: Result<Json<Command>, JsonRejection>,
) -> Response {
    match command {
        Ok(Json(command)) => {
            let commands = { server.0.commands.lock() }.unwrap_or_else(PoisonError::into_inner);
            match commands.send(command) {
                Ok(()) => StatusCode::ACCEPTED.into_response(),
                Err(_) => (StatusCode::GONE, "the program ends").into_response(),
            }
        }
        Err(wrong) => (StatusCode::UNPROCESSABLE_ENTITY, wrong.body_text()).into_response(),
    }
}

async fn site(State(server): State<Server>) -> Response {
    let work = move || match server.0.editing.as_ref().map(Editing::begun) {
        Some(begun) => answer(begun),
        None => StatusCode::NOT_FOUND.into_response(),
    };
    at_leisure(work).await
}

/// Does something on a thread on which it may take its time.
async fn at_leisure(work: impl FnOnce() -> Response + Send + 'static) -> Response {
    let done = tokio::task::spawn_blocking(work).await;
    done.unwrap_or_else(|_| StatusCode::INTERNAL_SERVER_ERROR.into_response())
}

fn answer(result: Result<impl Serialize, EditError>) -> Response {
    match result {
        Ok(result) => Json(result).into_response(),
        Err(EditError::Conflicts(all)) => (StatusCode::CONFLICT, Json(all)).into_response(),
        Err(EditError::File(words)) => (StatusCode::INTERNAL_SERVER_ERROR, words).into_response(),
        Err(error) => (StatusCode::UNPROCESSABLE_ENTITY, error.to_string()).into_response(),
    }
}

/// Answers a question about a layout.
async fn about_layout<T: Serialize + 'static>(
    server: Server,
    asked: Result<Json<Asked>, JsonRejection>,
    work: fn(&Editing, &Asked) -> Result<T, EditError>,
) -> Response {
    let Json(asked) = match asked {
        Ok(asked) => asked,
        Err(wrong) => {
            return (StatusCode::UNPROCESSABLE_ENTITY, wrong.body_text()).into_response();
        }
    };
    let work = move || match &server.0.editing {
        Some(editing) => answer(work(editing, &asked)),
        None => StatusCode::NOT_FOUND.into_response(),
    };
    at_leisure(work).await
}

async fn design(
    State(server): State<Server>,
    asked: Result<Json<Asked>, JsonRejection>,
) -> Response {
    about_layout(server, asked, Editing::judge).await
}

/// Writes the file, or answers with its text.
async fn save(State(server): State<Server>, asked: Result<Json<Asked>, JsonRejection>) -> Response {
    about_layout(server, asked, Editing::save).await
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Also in a build that keeps the digits of numbers.
    #[test]
    fn commands_have_fractions() {
        let command = |text: &str| serde_json::from_str::<Command>(text);
        let drift = r#"{"do":"drift","node":8,"seconds":2.5,"share":0.10}"#;
        let expected = Command::Drift {
            node: 8,
            seconds: 2.5,
            share: 0.1,
        };
        assert_eq!(command(drift).unwrap(), expected);
        let moved = r#"{"do":"move","node":3,"by":[0.5,-2],"turn_deg":1e1}"#;
        let expected = Command::Move {
            node: 3,
            by: [0.5, -2.0],
            turn_deg: 10.0,
        };
        assert_eq!(command(moved).unwrap(), expected);
        for command in [
            expected,
            Command::Speed { times: 2.5 },
            Command::Unplug {
                node: 1,
                seconds: 0.25,
            },
            Command::Jam { seconds: 0.5 },
        ] {
            let text = serde_json::to_string(&command).unwrap();
            assert_eq!(serde_json::from_str::<Command>(&text).unwrap(), command);
        }
        assert!(command(r#"{"do":"speed","times":"fast"}"#).is_err());
    }
}
