//! `cargo bench-peers`: this project's visibility beside its peers, in one run, on the same meshes and rays, everyone in
//! turn. Prints tables and writes them to `tests/benches/RESULTS.md`. Peers that are not installed are named as absent;
//! `tests/benches/install` installs them.
//!
//! Options after `--`: `--rounds N` (default 5), `--quick` (the smallest meshes, nothing written), and words that a
//! topic must contain one of: viewpoint, packets.

mod embree;
mod measure;
mod meshes;
mod packets;
mod python;
mod report;
mod rig;
mod viewpoint;

use std::cell::RefCell;
use std::fs;

use embree::Embree;
use measure::{Contestant, Pools, cost, race};
use packets::Caster;
use python::{Peer, Python};
use report::{Report, ms, number};
use vantage::cell::Scanner;
use vantage::geometry::Mesh;

/// What everyone is measured with.
struct Bench {
    rounds: usize,
    scanner: Scanner,
    pools: Pools,
    embree: Result<Embree, String>,
    python: Result<RefCell<Python>, String>,
    report: Report,
}

fn main() {
    let options = Options::parse(std::env::args().skip(1));
    let mut bench = Bench {
        rounds: options.rounds,
        scanner: rig::scanner(),
        pools: Pools::new(),
        embree: Embree::open(),
        python: Python::start().map(RefCell::new),
        report: Report::default(),
    };
    for (name, mesh) in meshes(options.quick) {
        match mesh {
            Ok(mesh) => bench.on_mesh(&format!("{name}, {} triangles", mesh.faces.len()), &mesh, &options),
            Err(reason) => bench.report.section(format!("{name}: absent, {reason}")),
        }
    }
    if !options.quick && options.topics.is_empty() {
        let text = bench.report.markdown(&heading(options.rounds));
        fs::write(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/benches/RESULTS.md"), text).expect("RESULTS.md can be written");
    }
}

fn meshes(quick: bool) -> Vec<(&'static str, Result<Mesh, String>)> {
    if quick {
        return vec![("lobed sphere", Ok(meshes::lobed(70_000)))];
    }
    vec![
        ("bunny", meshes::bunny(0)),
        ("bunny, split twice", meshes::bunny(2)),
        ("bunny, split three times", meshes::bunny(3)),
        ("lobed sphere", Ok(meshes::lobed(100_000))),
    ]
}

struct Options {
    rounds: usize,
    quick: bool,
    topics: Vec<String>,
}

impl Options {
    fn parse(mut words: impl Iterator<Item = String>) -> Self {
        let mut options = Self { rounds: 5, quick: false, topics: Vec::new() };
        while let Some(word) = words.next() {
            match word.as_str() {
                // What cargo adds.
                "--bench" => {}
                "--quick" => options.quick = true,
                "--rounds" => options.rounds = words.next().and_then(|n| n.parse().ok()).expect("--rounds N"),
                topic => options.topics.push(topic.to_owned()),
            }
        }
        options
    }

    fn wants(&self, topic: &str) -> bool {
        self.topics.is_empty() || self.topics.iter().any(|word| topic.contains(word.as_str()))
    }
}

impl Bench {
    fn on_mesh(&mut self, title: &str, mesh: &Mesh, options: &Options) {
        if let Ok(python) = &self.python {
            python.borrow_mut().load(mesh);
        }
        if options.wants("viewpoint") {
            self.report.section(format!("Viewpoint: {title}"));
            self.viewpoints(mesh);
        }
        if options.wants("packets") {
            self.report.section(format!("Packets: {title}"));
            self.packets(mesh);
        }
    }

    fn viewpoints(&mut self, mesh: &Mesh) {
        let views: Vec<_> = rig::views(&self.scanner).iter().map(|view| rig::eyes(&self.scanner, view)).collect();
        let robust = self.embree.as_ref().map(|embree| embree.scene(mesh, true)).map_err(String::clone);
        let (pools, python, triangles) = (&self.pools, &self.python, mesh.faces.len());
        let mut labels = Vec::new();
        let mut contestants: Vec<Contestant<'_>> = Vec::new();
        for threads in [1, 2] {
            labels.push(format!("Embree 3.13 packets, robust, {threads} threads"));
            contestants.push(robust.as_ref().map_err(String::clone).map(|scene| -> Box<dyn FnMut() -> _> {
                let (views, pool) = (&views, pools.of(threads));
                Box::new(move || {
                    let all = || views.iter().for_each(|eyes| drop(viewpoint::with_embree(scene, eyes, mesh)));
                    cost(|| pool.install(all)).1.over(views.len())
                })
            }));
        }
        let steps = RefCell::new([0.0; 3]);
        labels.push("Open3D, 2 threads".into());
        contestants.push(python.as_ref().map_err(String::clone).map(|python| -> Box<dyn FnMut() -> _> {
            let (views, steps) = (&views, &steps);
            Box::new(move || {
                let costs = views.iter().map(|eyes| python.borrow_mut().viewpoint(eyes, triangles, 2).0);
                let (mut whole, mut parts) = (measure::Cost::default(), [0.0; 3]);
                for cost in costs {
                    whole = whole + cost.whole;
                    (0..3).for_each(|i| parts[i] += cost.steps_wall_s[i] / views.len() as f64);
                }
                *steps.borrow_mut() = parts;
                whole.over(views.len())
            })
        }));
        let standings = race(self.rounds, contestants);
        let rows = labels.into_iter().zip(standings).map(|(label, median)| match median {
            Ok(cost) => vec![label, ms(cost.wall_s), ms(cost.cpu_s)],
            Err(reason) => vec![label, reason, String::new()],
        });
        self.report.table(&["engine", "wall, ms", "CPU, ms"], &rows.collect::<Vec<_>>());
        let [generate, cast, reduce] = steps.into_inner().map(ms);
        self.report
            .say(format!("Of Open3D's wall time {generate} ms make the rays, {cast} ms cast them, {reduce} ms reduce the hits."));
        if let (Ok(scene), Ok(python)) = (&robust, python) {
            let (_, theirs) = python.borrow_mut().viewpoint(&views[0], triangles, 2);
            let ours = pools.of(2).install(|| viewpoint::with_embree(scene, &views[0], mesh));
            let [each, all] = viewpoint::differing(&ours, &theirs).map(|share| number(share * 100.0));
            self.report.say(format!("Open3D and Embree robust differ on {each} % / {all} %."));
        }
    }

    fn packets(&mut self, mesh: &Mesh) {
        let [plain, robust] =
            [false, true].map(|robust| self.embree.as_ref().map(|embree| embree.scene(mesh, robust)).map_err(String::clone));
        let Ok(reference) = &robust else { return };
        let arrays = packets::arrays(&self.scanner, mesh, reference);
        if let Ok(python) = &self.python {
            arrays.iter().for_each(|rays| python.borrow_mut().keep_rays(rays.name, rays.origin_mm, &rays.directions_mm));
        }
        let casters: [Caster<'_>; 4] = [
            packets::embree("Embree 3.13, 16 wide", plain.as_ref(), &self.pools),
            packets::embree("Embree 3.13, 16 wide, robust", robust.as_ref(), &self.pools),
            packets::python(Peer::Open3d, &self.python),
            packets::python(Peer::Trimesh, &self.python),
        ];
        for rays in &arrays {
            packets::compare(&mut self.report, self.rounds, rays, &casters);
        }
    }
}

fn heading(rounds: usize) -> String {
    let cpu = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = cpu
        .lines()
        .find_map(|line| line.strip_prefix("model name"))
        .map_or("unknown CPU", |rest| rest.trim_start_matches([' ', '\t', ':']));
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    format!(
        "# Visibility beside its peers\n\n`cargo bench-peers` on {model}, {cores} cores; medians of {rounds} rounds in which everyone takes turns.\n"
    )
}
