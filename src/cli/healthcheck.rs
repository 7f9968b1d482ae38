//! `vantage healthcheck`: asks a server whether it is healthy; for containers that have no other HTTP client.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream, ToSocketAddrs};
use std::time::Duration;

use super::{CliError, output};

/// Check that a server is healthy: exit code 0 if it is, 1 if it is not.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:
  vantage healthcheck --url http://127.0.0.1:8080")]
pub struct HealthcheckArgs {
    /// Address of the server.
    #[arg(long, default_value = "http://127.0.0.1:8080")]
    url: String,
}

/// Timeout of each step: connect, write, read.
const STEP_TIMEOUT: Duration = Duration::from_secs(3);

/// Runs the command.
///
/// # Errors
/// [`CliError::BadInput`] for an address that is not HTTP, [`CliError::Failed`] if the server is not healthy.
pub fn run(args: &HealthcheckArgs) -> Result<(), CliError> {
    let host = args.url.strip_prefix("http://").map(|rest| rest.trim_end_matches('/'));
    let host = host.filter(|host| !host.is_empty() && !host.contains(['/', '\r', '\n', ' ']));
    let host = host.ok_or_else(|| CliError::BadInput(format!("--url {}: is not of the form http://HOST:PORT", args.url)))?;
    let answer = ask(host).map_err(|error| CliError::Failed(format!("{} does not answer: {error}", args.url)))?;
    match answer.split_whitespace().nth(1) {
        Some("200") if output::is_json() => output::json(&serde_json::json!({"url": args.url, "healthy": true})),
        Some("200") => Ok(()),
        _ => Err(CliError::Failed(format!("{} answers {:?}", args.url, answer.lines().next().unwrap_or_default()))),
    }
}

fn ask(host: &str) -> std::io::Result<String> {
    // The colons of an IPv6 address stand in brackets.
    let has_port = host.rsplit_once(':').is_some_and(|(_, port)| !port.ends_with(']'));
    let with_port = if has_port { host.to_owned() } else { format!("{host}:80") };
    let mut stream = connect(with_port.to_socket_addrs()?)?;
    stream.set_read_timeout(Some(STEP_TIMEOUT))?;
    stream.set_write_timeout(Some(STEP_TIMEOUT))?;
    write!(stream, "GET /healthz HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n")?;
    let mut answer = Vec::new();
    stream.take(4096).read_to_end(&mut answer)?;
    Ok(String::from_utf8_lossy(&answer).into_owned())
}

/// Connects to the first of the addresses that accepts: `localhost` may be `::1` before it is 127.0.0.1, where the server listens.
fn connect(addresses: impl Iterator<Item = SocketAddr>) -> std::io::Result<TcpStream> {
    let mut refused = std::io::Error::other("the host name has no address");
    for address in addresses {
        match TcpStream::connect_timeout(&address, STEP_TIMEOUT) {
            Ok(stream) => return Ok(stream),
            Err(error) => refused = error,
        }
    }
    Err(refused)
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::*;

    /// Only the first was tried, so that a healthy server was told as one that does not answer.
    #[test]
    fn every_address_of_the_host_is_tried() {
        let closed = SocketAddr::from(([127, 0, 0, 1], 1));
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let open = listener.local_addr().expect("an address");
        let stream = connect([closed, open].into_iter()).expect("the second accepts");
        assert_eq!(stream.peer_addr().expect("an address"), open);
        let refused = connect([closed].into_iter()).expect_err("nobody listens");
        assert_eq!(refused.kind(), std::io::ErrorKind::ConnectionRefused);
        assert_eq!(connect(std::iter::empty()).expect_err("none").to_string(), "the host name has no address");
    }
}
