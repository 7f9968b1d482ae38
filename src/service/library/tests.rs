//! Meshes that cannot be used, and those that cannot be read at the moment.

use super::*;
use crate::geometry::LengthUnit;
use crate::service::tests::service;

#[tokio::test]
async fn a_shortage_of_the_machine_is_no_error_of_the_request() {
    let (app, _folder) = service().await;
    let library = Library::new(app, Arc::default());
    let source = MeshSource { path: "/nowhere".into(), sha256: "ab".to_owned(), unit: LengthUnit::Millimetre };
    let kept = |error: JobError| {
        let said = error.to_string();
        assert_eq!(library.unusable(&source, error), NotFound::Unusable(said));
        library.take_error()
    };
    let busy = kept(JobError::Unavailable("too many open files".into()));
    assert!(busy.is_some_and(|error| error.is_transient()));
    let damaged = kept(JobError::Damaged("other bytes".into()));
    assert!(matches!(damaged, Some(Error::FileDamaged { missing: true, sha256 }) if sha256 == "ab"));
    assert!(kept(JobError::BadInput(Vec::new())).is_none(), "the mesh itself is at fault");
}
