//! Where the broker is, and why it cannot be had.

use std::{
    io::{self, ErrorKind},
    sync::Arc,
};

use percent_encoding::percent_decode_str;
use rumqttc::{
    ConnectReturnCode, ConnectionError, MqttOptions, NetworkOptions, StateError, TlsConfiguration,
    TlsError, Transport,
    tokio_rustls::rustls::{
        ClientConfig, RootCertStore,
        crypto::ring,
        pki_types::{CertificateDer, pem::PemObject},
    },
};
use url::Url;

use super::{KEEP_ALIVE, MESSAGE_MAX};

/// A broker, and the topic of a site there.
#[derive(Clone, Debug)]
pub struct Broker {
    host: String,
    port: u16,
    is_secure: bool,
    user: String,
    password: String,
    authorities: Option<Vec<u8>>,
    topic: String,
}

/// Reason why a broker is not to be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BrokerError {
    /// The URL is none of a broker.
    #[error("{0} is no URL of a broker, such as mqtt://user@host:1883/building: {1}")]
    Url(String, &'static str),
    /// The name of a publisher cannot be a level of a topic.
    #[error("{0:?} is no name of a publisher: take letters, digits, `-` and `_`")]
    Name(String),
    /// A certificate cannot be used.
    #[error("the certificates of authorities cannot be used: {0}")]
    Authorities(String),
    /// It is not there, or refuses.
    #[error("{0}")]
    Away(String),
    /// The machine does not let it run.
    #[error("the connection to the broker cannot be kept: {0}")]
    Run(#[from] io::Error),
    /// The machine gives no random numbers.
    #[error("there is no randomness for a client's name")]
    Random,
}

impl Broker {
    /// Reads a URL such as `mqtt://user@host:1883/building`, or `mqtts://` with TLS.
    ///
    /// # Errors
    /// [`BrokerError::Url`]
    pub fn parse(text: &str) -> Result<Self, BrokerError> {
        let wrong = |why| BrokerError::Url(without_password(text), why);
        let url = Url::parse(text).map_err(|_| wrong("it cannot be read"))?;
        let is_secure = match url.scheme() {
            "mqtt" => false,
            "mqtts" => true,
            _ => return Err(wrong("it begins with neither mqtt:// nor mqtts://")),
        };
        if url.password().is_some() {
            return Err(wrong(
                "other users of the computer can read it, so the password belongs in --password-file or \
                 MQTT_PASSWORD",
            ));
        }
        let plain = |text: &str| {
            let text = percent_decode_str(text).decode_utf8();
            text.map(String::from)
                .map_err(|_| wrong("it is no text in UTF-8"))
        };
        let host = url.host_str().filter(|host| !host.is_empty());
        let host = host.ok_or_else(|| wrong("it names no host"))?;
        let topic = plain(url.path().trim_matches('/'))?;
        if topic.is_empty() {
            return Err(wrong("the topic of the site is missing after the host"));
        }
        let is_odd = |c: char| c.is_control() || "+#$".contains(c);
        if topic.contains(is_odd) || topic.split('/').any(str::is_empty) {
            return Err(wrong("what follows the host cannot be a topic"));
        }
        if url.query().is_some() || url.fragment().is_some() {
            return Err(wrong("nothing follows the topic"));
        }
        Ok(Self {
            host: host.to_owned(),
            port: url.port().unwrap_or(if is_secure { 8883 } else { 1883 }),
            is_secure,
            user: plain(url.username())?,
            password: String::new(),
            authorities: None,
            topic,
        })
    }

    /// With this password of its user.
    #[must_use]
    pub fn with_password(self, password: String) -> Self {
        Self { password, ..self }
    }

    /// With these certificates of authorities, PEM, in the place of the system's.
    #[must_use]
    pub fn with_authorities(self, pem: Vec<u8>) -> Self {
        let authorities = Some(pem);
        Self {
            authorities,
            ..self
        }
    }

    /// Returns true if the URL names a user.
    pub fn has_user(&self) -> bool {
        !self.user.is_empty()
    }

    /// Returns true if the connection is a secure one.
    pub fn is_secure(&self) -> bool {
        self.is_secure
    }

    /// Topic of the site.
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// Name for people: host and port.
    pub fn address(&self) -> String {
        format!("{}:{}", self.host, self.port)
    }

    pub(super) fn options(&self, client: String) -> Result<MqttOptions, BrokerError> {
        let mut options = MqttOptions::new(client, &self.host, self.port);
        options.set_keep_alive(KEEP_ALIVE);
        options.set_max_packet_size(MESSAGE_MAX, MESSAGE_MAX);
        if !self.user.is_empty() || !self.password.is_empty() {
            options.set_credentials(&self.user, &self.password);
        }
        if self.is_secure {
            let config = TlsConfiguration::Rustls(Arc::new(self.tls()?));
            options.set_transport(Transport::tls_with_config(config));
        }
        Ok(options)
    }

    fn tls(&self) -> Result<ClientConfig, BrokerError> {
        let failed = |why: String| BrokerError::Authorities(why);
        let mut roots = RootCertStore::empty();
        let known = match &self.authorities {
            Some(pem) => { CertificateDer::pem_slice_iter(pem) }
                .collect::<Result<Vec<_>, _>>()
                .map_err(|error| failed(error.to_string()))?,
            None => rustls_native_certs::load_native_certs().certs,
        };
        roots.add_parsable_certificates(known);
        if roots.is_empty() {
            let why = "there are none: give a file of them, PEM, with --ca";
            return Err(failed(why.to_owned()));
        }
        let provider = Arc::new(ring::default_provider());
        let builder = ClientConfig::builder_with_provider(provider)
            .with_safe_default_protocol_versions()
            .map_err(|error| failed(error.to_string()))?;
        Ok(builder.with_root_certificates(roots).with_no_client_auth())
    }

    /// Words on why there is no connection.
    pub(super) fn trouble(&self, error: &ConnectionError) -> String {
        let at = self.address();
        match error {
            ConnectionError::ConnectionRefused(
                ConnectReturnCode::BadUserNamePassword | ConnectReturnCode::NotAuthorized,
            ) => format!(
                "the broker at {at} refuses the user or the password: the URL names the user, and --password-file \
                 or MQTT_PASSWORD has the password"
            ),
            ConnectionError::ConnectionRefused(code) => {
                format!("the broker at {at} refuses the connection: {code:?}")
            }
            ConnectionError::Tls(TlsError::Io(error)) if error.kind() != ErrorKind::InvalidData => {
                self.unreachable(error)
            }
            ConnectionError::Tls(error) => format!(
                "there is no secure connection to {at}: {error}; where the authority is your own, give its \
                 certificate with --ca"
            ),
            ConnectionError::Io(error) | ConnectionError::MqttState(StateError::Io(error)) => {
                self.unreachable(error)
            }
            ConnectionError::NetworkTimeout | ConnectionError::FlushTimeout => {
                format!("nothing answers at {at}")
            }
            ConnectionError::MqttState(StateError::AwaitPingResp) => {
                format!("the broker at {at} does not answer any more")
            }
            ConnectionError::MqttState(StateError::ConnectionAborted) => self.closed(),
            error => format!("the broker at {at} does not talk as expected: {error}"),
        }
    }

    /// A broker that closes a connection does not say why.
    fn closed(&self) -> String {
        let at = self.address();
        let why = if self.is_secure {
            "is this its port for secure connections, and has another program the same name?"
        } else {
            "has another program the same name, does it ask for a user, or for a secure connection (mqtts://)?"
        };
        format!("the broker at {at} closed the connection: {why}")
    }

    fn unreachable(&self, error: &io::Error) -> String {
        let at = self.address();
        match error.kind() {
            ErrorKind::ConnectionRefused => {
                format!("no broker listens at {at}: is it running, and is the port right?")
            }
            ErrorKind::ConnectionReset
            | ErrorKind::ConnectionAborted
            | ErrorKind::BrokenPipe
            | ErrorKind::UnexpectedEof => self.closed(),
            _ if error.to_string().contains("lookup") => {
                format!("the host {} is not known", self.host)
            }
            _ => format!("the broker at {at} cannot be reached: {error}"),
        }
    }
}

/// The same URL to be told, also if it is none: a password may stand between the user and the last `@`.
fn without_password(text: &str) -> String {
    let (scheme, rest) = text.split_at(text.find("://").map_or(0, |at| at + "://".len()));
    match rest.rsplit_once('@') {
        Some((user, host)) => {
            let user = user.split_once(':').map_or(user, |(user, _)| user);
            format!("{scheme}{user}@{host}")
        }
        None => text.to_owned(),
    }
}

/// Settings of the line to the broker.
pub(super) fn network() -> NetworkOptions {
    let mut options = NetworkOptions::new();
    options.set_tcp_nodelay(true);
    options
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn urls_name_host_port_user_and_topic() {
        let broker = Broker::parse("mqtt://me%40home@[::1]:1884/site/building/").unwrap();
        assert_eq!(broker.address(), "[::1]:1884");
        assert_eq!(
            (broker.user.as_str(), broker.topic()),
            ("me@home", "site/building")
        );
        assert_eq!(Broker::parse("mqtts://host/a").unwrap().port, 8883);
        for (url, why) in [
            ("host:1883/a", "neither"),
            ("building", "cannot be read"),
            ("http://host/a", "neither"),
            ("mqtt:///a", "no host"),
            ("mqtt://host", "topic of the site is missing"),
            ("mqtt://host/a/+/b", "cannot be a topic"),
            ("mqtt://host/a//b", "cannot be a topic"),
            ("mqtt://host/a?client_id=3", "nothing follows"),
        ] {
            let error = Broker::parse(url).unwrap_err().to_string();
            assert!(error.contains(why), "{url}: {error}");
        }
    }

    #[test]
    fn a_password_in_a_url_is_refused_and_not_told_again() {
        for (url, shown) in [
            ("mqtt://me:secret@host/a", "mqtt://me@host/a is no URL"),
            ("mqtt://me:p@secret@host/a", "mqtt://me@host/a is no URL"),
            // Other reasons to refuse them come first.
            ("mqtt://me:secret/more@host/a", "mqtt://me@host/a is no URL"),
            ("mqtt://me:secret@host:70000/a", "mqtt://me@host:70000/a is"),
            ("http://me:secret@host/a", "http://me@host/a is no URL"),
            ("me:secret@host/a", "me@host/a is no URL"),
        ] {
            let error = Broker::parse(url).unwrap_err().to_string();
            assert!(error.starts_with(shown), "{error}");
            assert!(!error.contains("secret"), "{error}");
        }
        let error = Broker::parse("mqtt://me:secret@host/a").unwrap_err();
        assert!(error.to_string().contains("--password-file"));
    }
}
