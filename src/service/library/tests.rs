//! Meshes that cannot be used, and those that cannot be read at the moment.

use super::*;
use crate::service::tests::service;

#[tokio::test]
async fn a_shortage_of_the_machine_is_no_error_of_the_request() {
    let (app, _folder) = service().await;
    let library = Library::new(app, Arc::default());
    for (error, is_busy) in
        [(JobError::Unavailable("too many open files".into()), true), (JobError::Damaged("other bytes".into()), false)]
    {
        let said = error.to_string();
        assert_eq!(library.unusable(error), NotFound::Unusable(said));
        assert_eq!(library.take_error().is_some_and(|error| error.is_transient()), is_busy);
    }
}
