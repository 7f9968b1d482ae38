//! Jobs of different sizes on the planning threads: small ones side by side, large ones on all of them, and nobody left waiting.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use vantage::planning::context::{Context, Stage};
use vantage::service::planner::{Artifact, JobError, JobInput};
use vantage::service::{self, JobSize, Planner, Sizer};

use super::api::{Api, http_options, service_options};

const THREADS: usize = 3;
const PATIENCE: Duration = Duration::from_secs(30);

/// Observations of the jobs that were planned.
#[derive(Default)]
struct Watch {
    /// Small jobs that run, and the greatest number of them at once.
    small: AtomicUsize,
    max_small: AtomicUsize,
    /// Label `n` and threads of each job.
    threads: Mutex<Vec<(String, usize)>>,
    /// Lets the jobs go on that wait at the gate.
    open: AtomicBool,
}

fn label<'a>(input: &'a JobInput, name: &str) -> &'a str {
    input.echo.labels.get(name).map_or("", String::as_str)
}

fn wait_until(ctx: &Context<'_>, is_so: impl Fn() -> bool) -> Result<(), JobError> {
    let until = Instant::now() + PATIENCE;
    while !is_so() {
        ctx.check().map_err(|_| JobError::Cancelled)?;
        if Instant::now() > until {
            return Err(JobError::NoPlan { reasons: "waited in vain".into(), report: Vec::new() });
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    Ok(())
}

impl Watch {
    /// A small job ends once [`THREADS`] of them have run at once, if it is told to meet others; a job at the gate once that opens.
    fn planner(self: &Arc<Self>) -> Planner {
        let watch = Arc::clone(self);
        Arc::new(move |input: &JobInput, ctx: &Context<'_>| {
            ctx.stage(Stage::Surface, || Ok::<_, JobError>(()))?;
            watch.threads.lock().expect("no panic").push((label(input, "n").to_owned(), rayon::current_num_threads()));
            let is_small = label(input, "size") == "small";
            if is_small {
                let at_once = 1 + watch.small.fetch_add(1, Ordering::SeqCst);
                watch.max_small.fetch_max(at_once, Ordering::SeqCst);
            }
            let ended = match label(input, "do") {
                "meet" => wait_until(ctx, || watch.max_small.load(Ordering::SeqCst) >= THREADS),
                "gate" => wait_until(ctx, || watch.open.load(Ordering::SeqCst)),
                _ => Ok(()),
            };
            if is_small {
                watch.small.fetch_sub(1, Ordering::SeqCst);
            }
            ended.map(|()| vec![Artifact { name: "report.txt".into(), bytes: b"done".to_vec() }])
        })
    }

    fn threads_of(&self, n: &str) -> usize {
        self.threads.lock().expect("no panic").iter().find(|(other, _)| other == n).expect("it ran").1
    }
}

/// Sizes by the label `size`.
fn sizer() -> Sizer {
    Arc::new(|input: &JobInput, _: &dyn Fn() -> bool| {
        let core_secs = if label(input, "size") == "small" { 1.0 } else { 1000.0 };
        JobSize { core_secs, bytes: 1e6 }
    })
}

async fn started(concurrent_jobs: usize) -> (Api, Arc<Watch>) {
    let watch = Arc::new(Watch::default());
    let options = service::Options { planning_threads: THREADS, concurrent_jobs, ..service_options() };
    (Api::start_planning(options, http_options(), watch.planner(), Some(sizer())).await, watch)
}

async fn submit(api: &Api, n: usize, size: &str, what: &str) -> String {
    let mesh = api.mesh().await;
    // Sizes are kept by mesh and parameters, which have to differ where sizes do.
    let params = json!({"seed": u8::from(size == "small")});
    let request =
        json!({"mesh_id": mesh, "cell": "none", "params": params, "labels": {"n": n.to_string(), "size": size, "do": what}});
    api.post_json("/api/v1/jobs", &request).await.ok(202)["id"].as_str().expect("an id").to_owned()
}

async fn state(api: &Api, job: &str) -> Value {
    api.get(&format!("/api/v1/jobs/{job}")).await.ok(200)["state"].clone()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn small_jobs_run_side_by_side_and_a_large_one_has_all_threads() {
    let (api, watch) = started(0).await;
    // While the first runs, all others arrive.
    let gate = submit(&api, 0, "large", "gate").await;
    api.running(&gate).await;
    let mut jobs = vec![gate];
    for n in 1..=6 {
        jobs.push(submit(&api, n, "small", "meet").await);
    }
    jobs.push(submit(&api, 7, "large", "").await);
    for n in 8..=10 {
        jobs.push(submit(&api, n, "small", "").await);
    }
    watch.open.store(true, Ordering::SeqCst);
    for job in &jobs {
        let ended = api.ended(job).await;
        assert_eq!(ended["state"], "succeeded", "{ended}");
    }
    assert_eq!(watch.max_small.load(Ordering::SeqCst), THREADS, "as many at once as there are threads, and no more");
    for n in 1..=6 {
        assert_eq!(watch.threads_of(&n.to_string()), 1, "job {n}");
    }
    for n in ["0", "7"] {
        assert_eq!(watch.threads_of(n), THREADS, "large job {n}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_small_job_does_not_wait_for_the_end_of_a_large_one() {
    let (api, watch) = started(0).await;
    let large = submit(&api, 0, "large", "gate").await;
    api.running(&large).await;
    let second = submit(&api, 1, "large", "gate").await;
    let small = submit(&api, 2, "small", "").await;
    assert_eq!(api.ended(&small).await["state"], "succeeded");
    assert_eq!((state(&api, &large).await, state(&api, &second).await), (json!("running"), json!("queued")));
    assert_eq!(watch.threads_of("2"), 1);
    // One on threads of its own is cancelled as any other.
    let waiting = submit(&api, 3, "small", "gate").await;
    api.running(&waiting).await;
    api.post_json(&format!("/api/v1/jobs/{waiting}/cancel"), &json!(null)).await.ok(202);
    assert_eq!(api.ended(&waiting).await["state"], "cancelled");
    watch.open.store(true, Ordering::SeqCst);
    for job in [large, second] {
        assert_eq!(api.ended(&job).await["state"], "succeeded");
    }
    assert_eq!([watch.threads_of("0"), watch.threads_of("1")], [THREADS; 2]);
}

/// Small jobs that arrive all the time do not keep a large one waiting.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_large_job_gets_its_turn_in_a_stream_of_small_ones() {
    let (api, watch) = started(0).await;
    let gate = submit(&api, 0, "small", "gate").await;
    api.running(&gate).await;
    let large = submit(&api, 1, "large", "").await;
    let mut later = Vec::new();
    for n in 2..20 {
        later.push(submit(&api, n, "small", "gate").await);
    }
    watch.open.store(true, Ordering::SeqCst);
    assert_eq!(api.ended(&large).await["state"], "succeeded");
    for job in later {
        api.ended(&job).await;
    }
    let order: Vec<String> = watch.threads.lock().expect("no panic").iter().map(|(n, _)| n.clone()).collect();
    let at = order.iter().position(|n| n == "1").expect("it ran");
    assert!(at <= 5, "large job 1 waited for {at} others: {order:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn one_job_at_a_time_where_that_is_set() {
    let (api, watch) = started(1).await;
    let gate = submit(&api, 0, "large", "gate").await;
    api.running(&gate).await;
    let mut jobs = Vec::new();
    for n in 1..=4 {
        jobs.push(submit(&api, n, "small", "").await);
    }
    assert_eq!(state(&api, &jobs[0]).await, "queued");
    watch.open.store(true, Ordering::SeqCst);
    for job in jobs {
        assert_eq!(api.ended(&job).await["state"], "succeeded");
    }
    assert_eq!(watch.max_small.load(Ordering::SeqCst), 1);
    assert_eq!((1..=4).map(|n| watch.threads_of(&n.to_string())).collect::<Vec<_>>(), [THREADS; 4]);
}
