//! Names in requests that stand for nothing usable.

use super::*;
use crate::service::store::Precondition;
use crate::service::tests::service;
use crate::wire::SpecCollection;

#[tokio::test]
async fn a_stored_specification_that_cannot_be_read_is_not_said_to_be_unknown() {
    let (app, _folder) = service().await;
    for collection in [SpecCollection::Scanner, SpecCollection::Cell] {
        app.0.store.put_spec(collection, "ours", "?", &Precondition::None).await.expect("stored");
    }
    let job = |cell: &str| JobRequest {
        cell: Named::Name(cell.to_owned()),
        scanner: Named::Name("ours".to_owned()),
        ..JobRequest::new(MeshId::generate())
    };
    for (cell, pointer, path) in [("none", "/scanner", "scanners/ours"), ("ours", "/cell", "cells/ours")] {
        let refused = app.submit(job(cell), Submission::default()).await.expect_err("it cannot be read");
        let Error::Invalid(errors) = refused else { panic!("{refused}") };
        let said = &errors.iter().find(|error| error.pointer == pointer).expect("an error").detail;
        assert!(said.contains("cannot be used: ") && said.contains(path) && !said.contains("known names"), "{said}");
    }
}
