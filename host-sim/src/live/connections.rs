//! Connections of the page's server: no more than it can hold, and none that stays silent.

use std::{
    net::SocketAddr,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use axum::{Extension, Router};
use hyper::server::conn::http1;
use hyper_util::{
    rt::{TokioIo, TokioTimer},
    service::TowerToHyperService,
};
use tokio::{net::TcpListener, task::AbortHandle};
use tracing::{debug, warn};

use crate::logging::Throttle;

/// Limits of a server.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// Number of connections at the same time.
    pub(super) connections: usize,
    /// Time for the head of a request, and for the silence between two requests.
    pub(super) silence: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            connections: 128,
            silence: Duration::from_secs(20),
        }
    }
}

/// A connection, as requests on it know it.
#[derive(Clone, Debug)]
pub(super) struct Connection {
    /// Address of the other end.
    pub(super) peer: SocketAddr,
    has_token: Arc<AtomicBool>,
}

impl Connection {
    fn of(peer: SocketAddr) -> Self {
        let has_token = Arc::default();
        Self { peer, has_token }
    }

    /// Notes that a request on it had the token.
    pub(super) fn is_owners(&self) {
        self.has_token.store(true, Ordering::Relaxed);
    }

    fn has_token(&self) -> bool {
        self.has_token.load(Ordering::Relaxed)
    }
}

/// Serves for ever. Where there are too many connections, the oldest one without the token is closed, so that others
/// cannot lock the owner out.
pub(super) async fn serve(listener: TcpListener, router: Router, limits: Limits) {
    let mut all: Vec<(Connection, AbortHandle)> = Vec::new();
    let [failed, full] = [(); 2].map(|()| Throttle::default());
    let silent: Arc<Throttle> = Arc::default();
    loop {
        let (stream, peer) = match listener.accept().await {
            Ok(accepted) => accepted,
            Err(error) => {
                if let Some(count) = failed.count(1) {
                    warn!(count, "a connection cannot be taken: {error}");
                }
                // Such as too many open files: some close in a while.
                tokio::time::sleep(Duration::from_millis(100)).await;
                continue;
            }
        };
        all.retain(|(_, task)| !task.is_finished());
        if all.len() >= limits.connections {
            if let Some(count) = full.count(1) {
                let limit = limits.connections;
                warn!(%peer, count, limit, "too many connections: some are closed");
            }
            let Some(oldest) = all.iter().position(|(one, _)| !one.has_token()) else {
                continue;
            };
            all.remove(oldest).1.abort();
        }
        let connection = Connection::of(peer);
        let router = router.clone().layer(Extension(connection.clone()));
        let served = http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(limits.silence)
            .serve_connection(TokioIo::new(stream), TowerToHyperService::new(router));
        let silent = silent.clone();
        let task = tokio::spawn(async move {
            // An end of any kind concerns this connection only.
            let Err(error) = served.await else { return };
            // Browsers leave connections open, too.
            if error.is_timeout()
                && let Some(count) = silent.count(1)
            {
                debug!(%peer, count, "a connection that says nothing is closed");
            }
        });
        all.push((connection, task.abort_handle()));
    }
}

#[cfg(test)]
mod tests {
    use std::{
        io::{Read, Write},
        net::{SocketAddr, TcpStream},
    };

    use super::*;
    use crate::live::server::{About, start};

    fn server(limits: Limits) -> (SocketAddr, String) {
        let about = About {
            name: "a".to_owned(),
            kind: "recorded",
            speed: 0.0,
        };
        let (server, _) = start("127.0.0.1:0".parse().unwrap(), about, None, limits).unwrap();
        let url = server.url();
        let (address, token) = url["http://".len()..].split_once("/#").unwrap();
        (address.parse().unwrap(), token.to_owned())
    }

    fn sends(address: SocketAddr, text: &str) -> TcpStream {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.write_all(text.as_bytes()).unwrap();
        stream
    }

    /// All that comes until the server hangs up.
    fn rest(mut stream: TcpStream) -> String {
        let mut text = Vec::new();
        // A reset is an end too.
        let _ = stream.read_to_end(&mut text);
        String::from_utf8(text).unwrap()
    }

    #[test]
    fn strangers_cannot_lock_the_owner_out() {
        let limits = Limits {
            connections: 4,
            ..Limits::default()
        };
        let (address, token) = server(limits);
        let of_owner = format!("GET /about?token={token} HTTP/1.1\r\nHost: {address}\r\n");
        let mut owner = sends(address, &format!("{of_owner}\r\n"));
        let mut answer = [0; 15];
        owner.read_exact(&mut answer).unwrap();
        assert_eq!(&answer, b"HTTP/1.1 200 OK");
        let mut half_open: Vec<_> = (0..12)
            .map(|_| sends(address, "GET / HTTP/1.1\r\n"))
            .collect();
        let other = sends(address, &format!("{of_owner}Connection: close\r\n\r\n"));
        assert!(rest(other).starts_with("HTTP/1.1 200 OK"));
        // The oldest is gone; that of the owner is not.
        assert_eq!(rest(half_open.remove(0)), "");
        let again = format!("{of_owner}Connection: close\r\n\r\n");
        owner.write_all(again.as_bytes()).unwrap();
        assert!(rest(owner).contains("HTTP/1.1 200 OK"));
    }

    #[test]
    fn a_connection_that_stays_silent_is_closed() {
        let limits = Limits {
            silence: Duration::from_millis(50),
            ..Limits::default()
        };
        let (address, token) = server(limits);
        assert_eq!(rest(sends(address, "")), "");
        assert_eq!(rest(sends(address, "GET / HTTP/1.1\r\nHo")), "");
        let whole = format!("GET /about?token={token} HTTP/1.1\r\nHost: {address}\r\n\r\n");
        assert!(rest(sends(address, &whole)).starts_with("HTTP/1.1 200 OK"));
    }

    #[test]
    fn a_stranger_is_refused_before_the_body_is_read() {
        let (address, _) = server(Limits::default());
        let head = format!(
            "POST /command HTTP/1.1\r\nHost: {address}\r\nOrigin: http://{address}\r\nX-Token: 0\r\n\
             Content-Type: application/json\r\nContent-Length: 2000000\r\nConnection: close\r\n\r\n"
        );
        assert!(rest(sends(address, &head)).starts_with("HTTP/1.1 403 Forbidden"));
    }
}
