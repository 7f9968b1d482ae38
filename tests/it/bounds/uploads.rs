//! Uploads that take long to make out: cut off after their time, when their client leaves, and when the service stops.

use std::cell::Cell;
use std::sync::Arc;
use std::time::{Duration, Instant};

use sha2::Digest as _;
use vantage::geometry::LengthUnit;
use vantage::service::planner::{JobError, MeshSource};
use vantage::service::{self, App, Error, FinishedUpload, MeshUpload};

use super::memory::write_soup;
use crate::http::api::service_options;

/// Triangles that take some seconds.
const LONG: u32 = 1_000_000;

struct Service {
    app: App,
    _folder: tempfile::TempDir,
    soup: Vec<u8>,
}

impl Service {
    async fn start(parse_limit: Duration) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let options = service::Options {
            data_dir: folder.path().join("data"),
            max_upload_bytes: 1 << 30,
            max_triangles: 20_000_000,
            parse_limit,
            ..service_options()
        };
        let app = App::open_with(options, Arc::new(|_, _| Ok(Vec::new())), None).await.expect("a service");
        let soup = folder.path().join("soup.stl");
        write_soup(&soup, LONG);
        let soup = std::fs::read(soup).expect("written");
        Self { app, _folder: folder, soup }
    }

    async fn received(&self, bytes: &[u8]) -> FinishedUpload {
        let mut upload = self.app.receive(bytes.len() as u64).await.expect("a place");
        upload.write(bytes.to_vec().into()).await.expect("taken");
        upload.finish(None).await.expect("on the disk")
    }

    async fn add(&self, upload: FinishedUpload) -> Result<vantage::wire::UploadedMesh, Error> {
        self.app.add_mesh(upload, MeshUpload { unit: LengthUnit::Millimetre, name: None }).await
    }
}

const TRIANGLE: &[u8] = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

#[tokio::test(flavor = "multi_thread")]
async fn a_mesh_that_takes_too_long_is_refused_with_the_time_and_the_setting() {
    let service = Service::start(Duration::from_millis(300)).await;
    let upload = service.received(&service.soup).await;
    let began = Instant::now();
    let error = service.add(upload).await.expect_err("too long");
    assert!(matches!(error, Error::MeshUnreadable(_)), "{error:?}");
    assert!(error.to_string().contains("0.3 s that limits.parse_secs allows"), "{error}");
    assert!(began.elapsed() < Duration::from_secs(2), "{:?}", began.elapsed());
    let upload = service.received(TRIANGLE).await;
    assert_eq!(service.add(upload).await.expect("quick").health.triangles, 1);
}

#[tokio::test(flavor = "multi_thread")]
async fn who_leaves_makes_room_for_others_at_once() {
    let service = Service::start(Duration::from_secs(600)).await;
    let places = std::thread::available_parallelism().map_or(1, Into::into);
    for _ in 0..places {
        let upload = service.received(&service.soup).await;
        let left = tokio::time::timeout(Duration::from_millis(100), service.add(upload)).await;
        assert!(left.is_err(), "it was not long enough: {left:?}");
    }
    let upload = service.received(TRIANGLE).await;
    let began = Instant::now();
    service.add(upload).await.expect("a mesh");
    assert!(began.elapsed() < Duration::from_secs(1), "{:?}", began.elapsed());
}

#[test]
fn a_job_that_is_cancelled_stops_reading_its_meshes() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("soup.stl");
    write_soup(&path, LONG / 4);
    let digest = sha2::Sha256::digest(std::fs::read(&path).expect("written"));
    let sha256: String = digest.iter().map(|byte| format!("{byte:02x}")).collect();
    let source = MeshSource { path, sha256, unit: LengthUnit::Millimetre };
    let looks = Cell::new(0);
    let cancelled = || {
        looks.set(looks.get() + 1);
        looks.get() > 3
    };
    let began = Instant::now();
    assert_eq!(source.read("/mesh_id", 20_000_000, &cancelled).map(|_| ()), Err(JobError::Cancelled));
    let gave_up = began.elapsed();
    let whole = source.read("/mesh_id", 20_000_000, &|| false).expect("a mesh");
    assert_eq!(whole.faces.len() as u32, LONG / 4);
    assert!(gave_up < (began.elapsed() - gave_up) / 4, "{gave_up:?}");
    let other = MeshSource { sha256: "0".repeat(64), ..source };
    assert!(matches!(other.read("/mesh_id", 20_000_000, &|| false), Err(JobError::Damaged(_))));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_service_that_stops_does_not_wait_for_a_mesh() {
    let service = Service::start(Duration::from_secs(600)).await;
    let upload = service.received(&service.soup).await;
    let app = service.app.clone();
    let adding = tokio::spawn(async move { app.add_mesh(upload, MeshUpload { unit: LengthUnit::Millimetre, name: None }).await });
    tokio::time::sleep(Duration::from_millis(100)).await;
    service.app.stop().await;
    let began = Instant::now();
    let ended = adding.await.expect("no panic");
    assert!(matches!(ended, Err(Error::Draining)), "{ended:?}");
    assert!(began.elapsed() < Duration::from_secs(1), "{:?}", began.elapsed());
}
