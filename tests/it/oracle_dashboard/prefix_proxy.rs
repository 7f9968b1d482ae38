//! A reverse proxy that serves a server below a path, and strips that from requests.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};

/// Path below which the proxy serves; it refuses everything else.
pub(super) const PREFIX: &str = "/plant/vantage";

/// Starts a proxy for the server at `target`; it lives as long as the process. Returns its address.
pub(super) fn start(target: SocketAddr) -> SocketAddr {
    let listener = TcpListener::bind(("127.0.0.1", 0)).expect("a port");
    let address = listener.local_addr().expect("an address");
    std::thread::spawn(move || {
        for client in listener.incoming().flatten() {
            std::thread::spawn(move || drop(pass_on(client, target)));
        }
    });
    address
}

/// Passes one request on and its answer back.
fn pass_on(client: TcpStream, target: SocketAddr) -> std::io::Result<()> {
    let mut from_client = BufReader::new(client.try_clone()?);
    let (mut head, mut line, mut length) = (String::new(), String::new(), 0);
    from_client.read_line(&mut head)?;
    let Some(stripped) = head.split_once(PREFIX).map(|(method, rest)| format!("{method}{rest}")) else {
        return (&client).write_all(b"HTTP/1.1 404 Not Found\r\ncontent-length: 0\r\nconnection: close\r\n\r\n");
    };
    // One request a connection.
    let mut request = format!("{stripped}connection: close\r\n");
    while from_client.read_line(&mut line)? > 2 {
        let name = line.split(':').next().unwrap_or_default().to_ascii_lowercase();
        if name == "content-length" {
            length = line[name.len() + 1..].trim().parse().unwrap_or_default();
        }
        if name != "connection" {
            request += &line;
        }
        line.clear();
    }
    let mut server = TcpStream::connect(target)?;
    server.write_all(request.as_bytes())?;
    server.write_all(b"\r\n")?;
    std::io::copy(&mut from_client.by_ref().take(length), &mut server)?;
    std::io::copy(&mut server, &mut &client)?;
    client.shutdown(Shutdown::Both)
}
