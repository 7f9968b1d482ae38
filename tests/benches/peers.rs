//! `cargo bench-peers`: this project's visibility beside its peers, in one run, on the same meshes and rays, everyone in
//! turn. Prints tables and writes them to `tests/benches/RESULTS.md`. Peers that are not installed are named as absent;
//! `tests/benches/install` installs them. About half an hour on two cores.
//!
//! Words after it choose among the topics and leave RESULTS.md alone: viewpoint, packets, engine, plan, area, memory,
//! instructions. `--rounds N`: how often everyone takes a turn, 5 unless asked otherwise. `--quick`: a small generated
//! part alone.

mod area;
mod embree;
mod engine;
mod instructions;
mod measure;
mod meshes;
mod packets;
mod planned;
mod python;
mod report;
mod rig;
mod viewpoint;

use std::cell::RefCell;
use std::fs;

use embree::Embree;
use measure::Pools;
use meshes::Part;
use python::Python;
use report::Report;
use vantage::cell::Scanner;

/// Tools that everyone is measured with.
struct Bench {
    rounds: usize,
    scanner: Scanner,
    pools: Pools,
    embree: Result<Embree, String>,
    python: Result<RefCell<Python>, String>,
    report: Report,
}

struct Options {
    rounds: usize,
    quick: bool,
    topics: Vec<String>,
}

fn main() {
    let options = Options::parse(std::env::args().skip(1));
    if let [word, kernel, level, times] = &options.topics[..]
        && word == instructions::WORD
    {
        return instructions::run(kernel, level, times);
    }
    let mut bench = Bench {
        rounds: options.rounds,
        scanner: rig::scanner(),
        pools: Pools::new(),
        embree: Embree::open(),
        python: Python::start().map(RefCell::new),
        report: Report::default(),
    };
    bench.run(&options);
    println!("{}", bench.report.figures());
    if !options.quick && options.topics.is_empty() {
        let text = bench.report.markdown(&heading(options.rounds));
        fs::write(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/benches/RESULTS.md"), text).expect("RESULTS.md can be written");
    }
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
                _ => options.topics.push(word),
            }
        }
        options
    }

    fn wants(&self, topic: &str) -> bool {
        self.topics.is_empty() || self.topics.iter().any(|word| word == topic)
    }
}

impl Bench {
    fn run(&mut self, options: &Options) {
        let parts = if options.quick { vec![meshes::small()] } else { meshes::parts() };
        for part in parts {
            self.on_part(&part.make(), options);
        }
        if options.wants("area") {
            area::section(self, options.quick);
        }
        if options.wants("memory") {
            planned::memory_section(self, options.quick);
        }
        if options.wants("instructions") {
            instructions::section(&mut self.report);
        }
    }

    fn on_part(&mut self, part: &Part, options: &Options) {
        if let Ok(python) = &self.python {
            python.borrow_mut().load(&part.mesh);
        }
        let open3d_s = options.wants("viewpoint").then(|| viewpoint::section(self, part)).flatten();
        if options.wants("packets") {
            packets::section(self, part);
        }
        let demanded = part.size.is_some() || options.quick;
        if options.wants("engine") && demanded {
            engine::section(self, part);
        }
        if options.wants("plan") && demanded {
            planned::section(self, part, open3d_s);
        }
    }
}

fn heading(rounds: usize) -> String {
    let proc = |file: &str| fs::read_to_string(format!("/proc/{file}")).unwrap_or_default();
    let field = |name: &str| {
        proc("cpuinfo")
            .lines()
            .find(|line| line.starts_with(name))
            .map(|line| line[line.find(':').unwrap_or(0) + 1..].trim().to_owned())
    };
    let cpu = field("model name").unwrap_or_else(|| "unknown CPU".into());
    let detail = field("cpu family")
        .zip(field("model\t"))
        .map_or_else(String::new, |(family, model)| format!(" (family {family}, model {model})"));
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let levels: Vec<_> = vantage::geometry::SimdLevel::available().into_iter().map(|level| level.as_str()).collect();
    let load = proc("loadavg");
    let load = load.split(' ').nth(1).unwrap_or("unknown");
    format!(
        "# Visibility compared with its peers\n\nWritten by `cargo bench-peers`, which says what each topic measures in its \
         sources beside this file. {cpu}{detail}, {cores} cores, {}. Medians of {rounds} rounds in which everyone takes \
         turns; load of the machine over the five minutes before the end: {load}.\n",
        levels.join(", ")
    )
}
