//! TLS before HTTP, in builds with the feature `tls`.

use super::listener::Connection;
use std::io;

/// Certificate and key of the server; there is none in a build without the feature.
#[derive(Clone)]
pub struct Tls(Acceptor);

#[cfg(feature = "tls")]
mod with_rustls {
    use super::*;
    use std::sync::Arc;
    use tokio_rustls::rustls::ServerConfig;
    use tokio_rustls::rustls::crypto::ring;
    use tokio_rustls::rustls::pki_types::pem::PemObject;
    use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};

    pub use tokio_rustls::TlsAcceptor as Acceptor;
    type Stream = tokio_rustls::server::TlsStream<Connection>;

    impl Tls {
        /// Both as PEM: the certificate first, then those that vouch for it.
        ///
        /// # Errors
        /// In words, without anything of the key.
        pub fn new(certificates: &[u8], key: &[u8]) -> Result<Self, String> {
            let chain: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(certificates).collect();
            let chain =
                chain.ok().filter(|chain| !chain.is_empty()).ok_or("server.certificate holds no certificate in PEM")?;
            let key = PrivateKeyDer::from_pem_slice(key).map_err(|_| "server.key holds no private key in PEM")?;
            let refused = |error: tokio_rustls::rustls::Error| format!("server.certificate and server.key: {error}");
            let mut config = ServerConfig::builder_with_provider(Arc::new(ring::default_provider()))
                .with_safe_default_protocol_versions()
                .map_err(refused)?
                .with_no_client_auth()
                .with_single_cert(chain, key)
                .map_err(refused)?;
            config.alpn_protocols = vec![b"http/1.1".to_vec()];
            Ok(Self(Acceptor::from(Arc::new(config))))
        }

        pub(in crate::http) async fn accept(&self, connection: Connection) -> io::Result<Stream> {
            self.0.accept(connection).await
        }
    }
}

#[cfg(not(feature = "tls"))]
mod without {
    use super::*;
    use std::convert::Infallible;

    pub type Acceptor = Infallible;

    impl Tls {
        /// # Errors
        /// Always: this build has no TLS.
        pub fn new(_certificates: &[u8], _key: &[u8]) -> Result<Self, String> {
            Err("server.certificate: this rigd was built without `--features tls`: build it with, or put a proxy with TLS before it".into())
        }

        pub(in crate::http) async fn accept(&self, _connection: Connection) -> io::Result<Connection> {
            match self.0 {}
        }
    }
}

#[cfg(feature = "tls")]
use with_rustls::Acceptor;
#[cfg(not(feature = "tls"))]
use without::Acceptor;
