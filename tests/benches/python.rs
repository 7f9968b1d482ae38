//! The peers written in Python: a process of `peers.py` in the environment that `tests/benches/install` makes. Requests
//! and answers are lines of JSON; arrays pass through files under `target/`. The costs in the answers are measured there,
//! around the peer's own work.

use std::fs;
use std::io::{BufRead, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use serde_json::{Value, json};
use vantage::cell::PerDevice;
use vantage::geometry::Mesh;

use crate::measure::Cost;
use crate::rig::Eye;

/// A peer's name on the wire.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Peer {
    /// `RaycastingScene`
    Open3d,
    /// `RayMeshIntersector`
    Trimesh,
}

impl Peer {
    fn as_str(self) -> &'static str {
        match self {
            Self::Open3d => "open3d",
            Self::Trimesh => "trimesh",
        }
    }

    /// Name of the peer where it is absent.
    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::Open3d => "Open3D",
            Self::Trimesh => "trimesh + embreex",
        }
    }

    /// The numbers of threads that it can run on.
    pub(crate) fn threads(self) -> &'static [usize] {
        match self {
            Self::Open3d => &[1, 2],
            Self::Trimesh => &[1],
        }
    }
}

/// A running process.
pub(crate) struct Python {
    process: Child,
    requests: ChildStdin,
    answers: BufReader<ChildStdout>,
    folder: PathBuf,
}

/// Cost of a whole viewpoint, and the share of its steps in wall seconds.
pub(crate) struct ViewpointCost {
    /// Everything.
    pub(crate) whole: Cost,
    /// Making the rays, casting them, reducing the hits to triangles.
    pub(crate) steps_wall_s: [f64; 3],
}

impl Python {
    /// Starts it; or says why it cannot.
    pub(crate) fn start() -> Result<Self, String> {
        let target = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/target"));
        let interpreter = target.join("peers/bin/python");
        if !interpreter.exists() {
            return Err("not installed; tests/benches/install does it".into());
        }
        let folder = target.join("bench-peers");
        fs::create_dir_all(&folder).map_err(|error| error.to_string())?;
        let mut process = Command::new(interpreter)
            .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/benches/peers.py"))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| format!("does not start: {error}"))?;
        let (requests, answers) = (process.stdin.take().expect("piped"), process.stdout.take().expect("piped"));
        Ok(Self { process, requests, answers: BufReader::new(answers), folder })
    }

    /// Name and version of a peer.
    pub(crate) fn version(&mut self, peer: Peer) -> String {
        self.ask(json!({ "request": "versions" }))[peer.as_str()].as_str().expect("a version").to_owned()
    }

    /// Makes `mesh` the one that later requests are about.
    pub(crate) fn load(&mut self, mesh: &Mesh) {
        let vertices: Vec<f32> = mesh.vertices_mm.iter().flat_map(|p| p.iter().map(|x| *x as f32).collect::<Vec<_>>()).collect();
        let vertices = self.write("vertices", vertices.iter().flat_map(|x| x.to_le_bytes()));
        let faces = self.write("faces", mesh.faces.iter().flatten().flat_map(|v| v.to_le_bytes()));
        self.ask(json!({ "request": "mesh", "vertices": vertices, "faces": faces }));
    }

    /// Every pixel ray of three devices with Open3D. Also which triangles each device meets.
    pub(crate) fn viewpoint(
        &mut self,
        eyes: &PerDevice<Eye>,
        triangles: usize,
        threads: usize,
    ) -> (ViewpointCost, PerDevice<Vec<bool>>) {
        let description = |eye: &Eye| {
            let rows = |m: &[f64], n: usize| m.chunks(n).map(<[f64]>::to_vec).collect::<Vec<_>>();
            json!({
                "intrinsic": rows(eye.intrinsic().transpose().as_slice(), 3),
                "device_from_part": rows(eye.device_from_part.to_homogeneous().transpose().as_slice(), 4),
                "width_px": eye.lens.width_px as u32,
                "height_px": eye.lens.height_px as u32,
            })
        };
        let devices: Vec<_> = eyes.iter().map(description).collect();
        let seen = self.folder.join("seen");
        let answer = self.ask(json!({ "request": "viewpoint", "devices": devices, "seen": seen, "threads": threads }));
        let step = |name: &str| answer[name].as_f64().expect("seconds");
        let cost = ViewpointCost { whole: cost_of(&answer), steps_wall_s: ["generate_s", "cast_s", "reduce_s"].map(step) };
        let masks = fs::read(seen).expect("written by the peer");
        let mask = |device: usize| masks[device * triangles..][..triangles].iter().map(|byte| *byte != 0).collect();
        (cost, PerDevice { left: mask(0), right: mask(1), projector: mask(2) })
    }

    /// Keeps rays with a common origin under `name`.
    pub(crate) fn keep_rays(&mut self, name: &str, origin: [f32; 3], directions: &[[f32; 3]]) {
        let file = self.write("directions", directions.iter().flatten().flat_map(|x| x.to_le_bytes()));
        self.ask(json!({ "request": "rays", "name": name, "origin": origin, "directions": file }));
    }

    /// The first face that each of the kept rays meets.
    pub(crate) fn first_faces(&mut self, peer: Peer, name: &str, threads: usize, faces: &mut [u32]) -> Cost {
        let file = self.folder.join("faces-met");
        let cost = self.ask_rays("first", peer, name, threads, &file, json!({}));
        let bytes = fs::read(file).expect("written by the peer");
        faces.iter_mut().zip(bytes.as_chunks().0).for_each(|(face, word)| *face = u32::from_le_bytes(*word));
        cost
    }

    /// Finds whether anything lies on each of the kept rays up to `end` times its length.
    pub(crate) fn blocked(&mut self, peer: Peer, name: &str, end: f32, threads: usize, blocked: &mut [bool]) -> Cost {
        let file = self.folder.join("blocked");
        let cost = self.ask_rays("blocked", peer, name, threads, &file, json!({ "end": end }));
        let bytes = fs::read(file).expect("written by the peer");
        blocked.iter_mut().zip(bytes).for_each(|(blocked, byte)| *blocked = byte != 0);
        cost
    }

    fn ask_rays(&mut self, request: &str, peer: Peer, name: &str, threads: usize, answer: &Path, mut more: Value) -> Cost {
        more["request"] = request.into();
        more["peer"] = peer.as_str().into();
        more["name"] = name.into();
        more["threads"] = threads.into();
        more["answer"] = json!(answer);
        cost_of(&self.ask(more))
    }

    fn write(&self, name: &str, bytes: impl Iterator<Item = u8>) -> PathBuf {
        let file = self.folder.join(name);
        fs::write(&file, bytes.collect::<Vec<_>>()).expect("target/ can be written");
        file
    }

    fn ask(&mut self, request: Value) -> Value {
        writeln!(self.requests, "{request}").expect("the peers' process reads");
        let mut line = String::new();
        self.answers.read_line(&mut line).expect("the peers' process answers");
        serde_json::from_str(&line).expect("an answer; what went wrong stands on standard error")
    }
}

impl Drop for Python {
    fn drop(&mut self) {
        // Fails only if it has ended already.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn cost_of(answer: &Value) -> Cost {
    let seconds = |name: &str| answer[name].as_f64().expect("seconds");
    Cost { wall_s: seconds("wall_s"), cpu_s: seconds("cpu_s") }
}
