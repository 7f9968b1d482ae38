//! The name that a request is for, over a real socket.

use super::process::Server;

#[test]
fn a_rebound_name_reads_submits_and_deletes_nothing() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[]);
    let mesh = server.upload().expect("a mesh");
    let path = format!("/api/v1/meshes/{}", mesh["id"].as_str().expect("an id"));
    for (method, path) in [("GET", "/"), ("GET", "/api/v1/jobs"), ("GET", &path), ("DELETE", &path), ("POST", "/api/v1/jobs")] {
        // All that a browser would say of a page whose name was pointed here: same origin, and no other.
        let request = format!(
            "{method} {path} HTTP/1.1\r\nhost: evil.example:{port}\r\norigin: http://evil.example:{port}\r\n\
             sec-fetch-site: same-origin\r\nconnection: close\r\ncontent-length: 0\r\n\r\n",
            port = server.address.port()
        );
        let answer = server.raw(request.as_bytes());
        assert!(answer.starts_with("HTTP/1.1 421") && answer.contains("server.hosts"), "{method} {path}: {answer}");
    }
    assert_eq!(server.get(&path).expect("still there"), mesh);
}

#[test]
fn one_host_no_more_and_no_less() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[("VANTAGE_SERVER__HOSTS", "planner,planner.plant.example")]);
    for (head, status) in [
        ("GET /healthz HTTP/1.1\r\nconnection: close\r\n", "400"),
        ("GET /healthz HTTP/1.1\r\nhost: localhost\r\nhost: localhost\r\nconnection: close\r\n", "400"),
        ("GET /healthz HTTP/1.1\r\nhost: localhost\r\nhost: evil.example\r\nconnection: close\r\n", "400"),
        ("GET http://evil.example/healthz HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n", "400"),
        ("GET /healthz HTTP/1.1\r\nhost: evil.example\r\nconnection: close\r\n", "421"),
        ("GET /healthz HTTP/1.1\r\nhost: Planner:8080\r\nconnection: close\r\n", "200"),
        ("GET /healthz HTTP/1.1\r\nhost: 10.1.2.3:8080\r\nconnection: close\r\n", "200"),
        ("GET /healthz HTTP/1.0\r\n", "200"),
    ] {
        let answer = server.raw(format!("{head}\r\n").as_bytes());
        let found = answer.split(' ').nth(1).unwrap_or_default();
        assert_eq!(found, status, "{head}: {answer}");
    }
}
