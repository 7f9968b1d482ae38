//! Pools of threads.

use std::collections::HashSet;
use std::path::Path;
use std::thread::current;

use super::*;
use crate::service::tests::options;

/// A worker takes up whatever else is in its pool, so no two tasks are ever in one.
#[tokio::test]
async fn every_task_beside_the_jobs_has_threads_of_its_own() {
    let planner = Arc::new(|_: &JobInput, _: &Context<'_>| Ok(Vec::new()));
    let sizer = Arc::new(|_: &JobInput, _: &dyn Fn() -> bool| JobSize::NOTHING);
    let runner = JobRunner::new(&options(Path::new("nowhere")), planner, sizer).expect("threads");
    let threads = runner.pool.current_num_threads();
    let computed = async || {
        let work = |_: &Context<'_>| (current().id(), rayon::current_num_threads());
        runner.compute(Arc::default(), work).await.expect("no panic")
    };
    let installed = || (current().id(), rayon::current_num_threads());
    let found = [computed().await, computed().await, runner.install(installed), runner.install(installed)];
    let workers = runner.pool.broadcast(|_| current().id());
    let distinct: HashSet<_> = found.iter().map(|(thread, _)| *thread).chain(workers).collect();
    assert_eq!(distinct.len(), found.len() + threads, "{distinct:?}");
    assert!(found.iter().all(|(_, own)| *own == threads), "{found:?}");
}
