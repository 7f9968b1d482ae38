//! A file of triangles that share no vertex takes no more than three times its size in memory.

use std::io::Write as _;
use std::path::Path;
use std::time::Duration;

use super::measured::{peak_of, run};
use crate::server::process::{Server, vantage};

const TRIANGLES: u32 = 2_000_000;
const LIMIT: Duration = Duration::from_secs(600);

/// A binary STL file of triangles none of which shares a vertex with another; its size.
pub(super) fn write_soup(path: &Path, triangles: u32) -> u64 {
    let mut file = std::io::BufWriter::new(std::fs::File::create(path).expect("a file"));
    let mut head = [0; 84];
    head[80..].copy_from_slice(&triangles.to_le_bytes());
    file.write_all(&head).expect("written");
    for i in 0..triangles {
        let [x, y] = [i % 2000, i / 2000].map(|i| i as f32 * 0.1);
        let corners = [[x, y, 0.0], [x + 0.07, y, 0.0], [x, y + 0.07, 0.0]];
        file.write_all(&[0; 12]).expect("written");
        corners.iter().flatten().for_each(|value| file.write_all(&value.to_le_bytes()).expect("written"));
        file.write_all(&[0; 2]).expect("written");
    }
    file.flush().expect("written");
    path.metadata().expect("there").len()
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_soup_takes_three_times_its_file_when_it_is_inspected_and_when_it_is_uploaded() {
    if !cfg!(target_os = "linux") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let soup = folder.path().join("soup.stl");
    let file_bytes = write_soup(&soup, TRIANGLES);
    let small = folder.path().join("small.stl");
    write_soup(&small, 10);

    let inspect = |file: &Path| run(vantage().arg("inspect").arg(file).args(["--unit", "mm"]), LIMIT);
    let (large, base) = (inspect(&soup), inspect(&small));
    assert!(large.code == Some(0) && large.said.contains("vertices    6000000"), "{}", large.said);
    let growth = large.peak_bytes - base.peak_bytes;
    assert!(growth <= 3 * file_bytes, "inspect: {growth} bytes for {file_bytes}");

    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[]);
    let upload = |file: &Path| {
        let body = std::fs::File::open(file).expect("there");
        ureq::post(server.url("/api/v1/meshes?unit=mm")).send(body).expect("taken").status()
    };
    assert_eq!(upload(&small), 201);
    let before = peak_of(server.process());
    assert_eq!(upload(&soup), 201);
    let growth = peak_of(server.process()) - before;
    assert!(growth <= 3 * file_bytes, "upload: {growth} bytes for {file_bytes}");
}
