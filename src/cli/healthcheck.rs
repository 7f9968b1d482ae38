//! `vantage healthcheck`: asks a server whether it is healthy; for containers that have no other HTTP client.

use std::io::{Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
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
    let with_port = if host.rsplit_once(':').is_some() { host.to_owned() } else { format!("{host}:80") };
    let address = with_port.to_socket_addrs()?.next().ok_or_else(|| std::io::Error::other("the host name has no address"))?;
    let mut stream = TcpStream::connect_timeout(&address, STEP_TIMEOUT)?;
    stream.set_read_timeout(Some(STEP_TIMEOUT))?;
    stream.set_write_timeout(Some(STEP_TIMEOUT))?;
    write!(stream, "GET /healthz HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n")?;
    let mut answer = Vec::new();
    stream.take(4096).read_to_end(&mut answer)?;
    Ok(String::from_utf8_lossy(&answer).into_owned())
}
