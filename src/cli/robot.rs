//! `vantage robot`: makes a robot's specification from its URDF file.

use std::fs;
use std::path::{Path, PathBuf};

use super::check::warn;
use super::doubts::{self, doubt};
use super::ranges::number;
use super::{CliError, files, output, spec_paths};
use crate::cell::urdf::{Imported, LinkSurface, UrdfOptions, UrdfRemark, import};
use crate::cell::{Dialect, KinematicsSpec, LinkBodySpec, PoseSpec, RobotSpec, ShapeSpec, SpecKind};
use crate::geometry::mesh_io::{self, Limits};
use crate::geometry::{LengthUnit, Mesh};
use crate::wire::warnings::FieldWarning;
use crate::wire::words::counted;

/// Write a robot specification from a URDF file: joints, limits, and capsules around the collision shapes.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  vantage robot elfin5.urdf --payload 5 --dialect hans --out elfin5.toml
  vantage robot elfin5.urdf --payload 5 --out elfin5.toml --surfaces elfin5
  vantage robot cell.urdf --base base_link --tip tool0 --packages ros/src \\
      --payload 10 --out arm.toml

A URDF states neither payload nor accelerations: give --payload, and --ramp unless joints reach full speed in half a \
second. Name the file as the `robot` of a cell. A server takes the same fields as JSON, with PUT /api/v1/robots/{name}.

With --surfaces, near-collisions are re-checked on the exact meshes: tighter moves, slower checks. For a server, upload each \
surface as a mesh and replace its file name with the mesh's id.")]
pub struct RobotArgs {
    /// URDF file; expand xacro first.
    pub urdf: PathBuf,
    /// TOML file to write.
    #[arg(long)]
    pub out: PathBuf,
    /// Folder for the surfaces of the links, written as STL in millimetres; the specification then refers to them.
    #[arg(long, value_name = "DIR")]
    pub surfaces: Option<PathBuf>,
    /// Name of the robot [default: the name in the file].
    #[arg(long)]
    pub name: Option<String>,
    /// Name of the base link, which does not move [default: base_link, else the root link].
    #[arg(long)]
    pub base: Option<String>,
    /// Name of the flange link [default: tool0, flange, ee_link or tcp, else the first link in the file that ends the arm six joints
    /// from the base].
    #[arg(long)]
    pub tip: Option<String>,
    /// Maximum mass at the flange, kg.
    #[arg(long, value_parser = positive)]
    pub payload: f64,
    /// Language of the robot's controller.
    #[arg(long, help = format!(
        "Language of the robot's controller: {}; programs in another maker's language are then refused",
        Dialect::ALL.map(Dialect::as_str).join(", ")
    ))]
    pub dialect: Option<Dialect>,
    /// Time that a joint takes to reach its rated speed, s.
    #[arg(long, default_value_t = 0.5, value_parser = positive)]
    pub ramp: f64,
    /// Folder with a subfolder NAME for each `package://NAME` [default: the URDF's folder, then its parents].
    #[arg(long)]
    pub packages: Option<PathBuf>,
}

fn positive(text: &str) -> Result<f64, String> {
    let number = number(text)?;
    if number.is_finite() && number > 0.0 { Ok(number) } else { Err(format!("is {number}; allowed is above 0")) }
}

/// Reads the URDF and its meshes, and writes the specification.
///
/// # Errors
/// [`CliError::BadInput`] if a file cannot be read or written, or does not describe a usable robot.
pub fn run(args: &RobotArgs) -> Result<(), CliError> {
    let at = |path: &Path, error: &dyn std::fmt::Display| CliError::BadInput(format!("{}: {error}", path.display()));
    let wanted = "a URDF file";
    if args.urdf.exists() {
        files::refuse_mesh(&args.urdf, wanted)?;
    }
    let text = files::text(&args.urdf)?;
    if let Some(what) = files::instead_of_file(&args.urdf, (wanted, None)) {
        return Err(at(&args.urdf, &what));
    }
    let options = UrdfOptions {
        name: args.name.clone(),
        base_link: args.base.clone(),
        tip_link: args.tip.clone(),
        payload_kg: args.payload,
        ramp_secs: args.ramp,
    };
    let mut load = |name: &str| read_mesh(&find_mesh(name, args)?);
    let mut imported = import(&text, &options, &mut load).map_err(|error| at(&args.urdf, &error))?;
    imported.set_dialect(args.dialect);
    let Imported { robot: mut spec, base_link, flange_link, surfaces, remarks } = imported;
    let warnings = warnings(&remarks, &spec);
    warn(&args.urdf.display().to_string(), &warnings);
    if let Some(folder) = &args.surfaces {
        fs::create_dir_all(folder).map_err(|error| at(folder, &error))?;
        let places = (folder.as_path(), args.out.as_path());
        let written = surfaces.iter().enumerate().map(|(index, surface)| write_surface(surface, index, places));
        spec.surfaces = written.collect::<Result<_, _>>()?;
    }
    if let Err(errors) = spec.build() {
        let all: Vec<String> = errors.iter().map(ToString::to_string).collect();
        return Err(at(&args.urdf, &all.join("; ")));
    }
    files::write(&args.out, file_text(&name_of(&args.urdf), &spec, (&base_link, &flange_link))?.as_bytes())?;
    let document = serde_json::json!({
        "file": args.out.display().to_string(), "robot": spec.name, "kinematics": kinematics(&spec), "capsules": spec.links.len(),
        "surfaces": spec.surfaces.len(), "base_link": base_link, "flange_link": flange_link, "warnings": warnings,
    });
    let ends = format!("base {base_link:?}, flange {flange_link:?}");
    output::result(&document, format_args!("{}: {}; {ends}\n", args.out.display(), summary(&spec)))
}

/// The specification's file, with its source: the URDF and the links of it that are base and flange.
fn file_text(urdf: &str, spec: &RobotSpec, (base_link, flange_link): (&str, &str)) -> Result<String, CliError> {
    let toml = output::toml(spec)?;
    Ok(format!(
        "# From {urdf}, its base the link {base_link:?}, its flange the link {flange_link:?}.\n\
         # Check limits, speeds and accelerations against the manufacturer's data sheet.\n{toml}"
    ))
}

/// Warnings of what is not as in the file, and of what is doubtful in the specification.
fn warnings(remarks: &[UrdfRemark], spec: &RobotSpec) -> Vec<FieldWarning> {
    let told = remarks.iter().map(|UrdfRemark { detail, remedy }| doubt("", detail, remedy));
    let doubts = serde_json::to_value(spec).map(|document| doubts::of_document(&document)).unwrap_or_default();
    told.chain(doubts).collect()
}

/// Writes a link's surface to a folder; the entry that refers to it in the specification's file.
fn write_surface(surface: &LinkSurface, index: usize, (folder, out): (&Path, &Path)) -> Result<LinkBodySpec, CliError> {
    // Links of a URDF may have any name; the number keeps file names distinct.
    let plain = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    let name: String = surface.name.chars().map(plain).collect();
    let path = folder.join(format!("{index:02}-{name}.stl"));
    files::write(&path, &mesh_io::write_stl(&surface.mesh))?;
    let shape = ShapeSpec::Mesh { mesh: spec_paths::name_for(out, SpecKind::Mesh, &path.to_string_lossy()) };
    Ok(LinkBodySpec { link: surface.link, name: surface.name.clone(), owner_from_body: PoseSpec::default(), shape })
}

/// Closed form of an arm from a URDF, or `iterative`.
fn kinematics(spec: &RobotSpec) -> &'static str {
    match &spec.kinematics {
        KinematicsSpec::Chain(chain) => chain.build().closed_form().unwrap_or("iterative"),
        KinematicsSpec::Opw(_) => "opw",
        KinematicsSpec::Ur(_) => "ur",
    }
}

fn summary(spec: &RobotSpec) -> String {
    let form = match kinematics(spec) {
        "opw" => "analytic inverse kinematics (ortho-parallel, spherical wrist)",
        "iterative" => "iterative inverse kinematics (no known closed form)",
        _ => "analytic inverse kinematics (three parallel axes)",
    };
    let surfaces =
        if spec.surfaces.is_empty() { String::new() } else { format!(", {}", counted(spec.surfaces.len(), "surface")) };
    format!("{}, {form}; {}{surfaces}", spec.name, counted(spec.links.len(), "capsule"))
}

fn name_of(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Resolves a name such as `package://NAME/meshes/link.stl`, `file:///…` or `meshes/link.stl`.
fn find_mesh(name: &str, args: &RobotArgs) -> Result<PathBuf, String> {
    if let Some(path) = name.strip_prefix("file://") {
        return Ok(path.into());
    }
    let relative = name.strip_prefix("package://").unwrap_or(name);
    let home = fs::canonicalize(&args.urdf).map_err(|error| error.to_string())?;
    let folders: Vec<&Path> = match &args.packages {
        Some(folder) => vec![folder],
        None => home.ancestors().skip(1).collect(),
    };
    let found = folders.iter().map(|folder| folder.join(relative)).find(|path| path.is_file());
    found.ok_or_else(|| format!("was not found below {}; name the folder of the packages with --packages", folders[0].display()))
}

/// Reads a mesh without scaling it: coordinates of a URDF are metres.
fn read_mesh(path: &Path) -> Result<Mesh, String> {
    let bytes = fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let read = mesh_io::read(&bytes, Some(LengthUnit::Millimetre), &Limits::default());
    read.map(|read| read.mesh).map_err(|error| format!("{}: {error}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::arm_urdf;

    /// An STL was told to be no TOML or JSON file, and a cell to have an unknown token at 1:1.
    #[test]
    fn what_is_no_urdf_is_told_by_what_it_is() {
        let folder = tempfile::tempdir().expect("a folder");
        let told = |name: &str, text: &str| {
            let urdf = folder.path().join(name);
            fs::write(&urdf, text).expect("a file");
            let (out, dialect, surfaces) = (folder.path().join("arm.toml"), None, None);
            let (name, base, tip, packages) = (None, None, None, None);
            let args = RobotArgs { urdf, out, surfaces, name, base, tip, payload: 5.0, dialect, ramp: 0.5, packages };
            run(&args).expect_err("no URDF").to_string()
        };
        let mesh = told("base.stl", "solid base\nendsolid\n");
        assert!(mesh.ends_with("base.stl: is a mesh, not a URDF file; `vantage inspect` examines it"), "{mesh}");
        let cell = told("cell.toml", "base_from_table = {}\n");
        assert!(cell.contains("cell.toml: is a cell, not a URDF file; `vantage check "), "{cell}");
        let broken = told("arm.urdf", "<robot>");
        assert!(broken.contains("arm.urdf: is not a URDF file: "), "{broken}");
    }

    /// Neither the file nor the output said which link was taken as the flange.
    #[test]
    fn the_file_names_the_links_that_are_base_and_flange() {
        let options = UrdfOptions { name: None, base_link: None, tip_link: None, payload_kg: 5.0, ramp_secs: 0.5 };
        let imported = import(&arm_urdf("revolute"), &options, &mut |_: &str| Err("no mesh".to_owned())).expect("a robot");
        let links = (imported.base_link.as_str(), imported.flange_link.as_str());
        let text = file_text("six.urdf", &imported.robot, links).expect("a text");
        assert!(
            text.starts_with("# From six.urdf, its base the link \"base_link\", its flange the link \"tool0\".\n# Check "),
            "{text}"
        );
    }

    /// An arm without its forearm was written without a word.
    #[test]
    fn a_link_that_is_left_out_is_warned_of_and_doubted() {
        let options = UrdfOptions { name: None, base_link: None, tip_link: None, payload_kg: 5.0, ramp_secs: 0.5 };
        let text = arm_urdf("revolute");
        let [before, after] = ["<link name=\"link_3\"><collision>", "<link name=\"link_4\">"].map(|part| text.find(part));
        let of_link_3 = &text[before.expect("link 3")..after.expect("link 4")];
        let visual = of_link_3.replace("collision>", "visual>");
        let found = |text: &str| {
            let imported = import(text, &options, &mut |_: &str| Err("no mesh".to_owned())).expect("a robot");
            warnings(&imported.remarks, &imported.robot)
        };
        assert_eq!(found(&text), []);
        let told = found(&text.replace(of_link_3, &visual));
        let [left_out, bare] = &told[..] else { panic!("two warnings: {told:#?}") };
        assert!(left_out.detail.contains("link \"link_3\""), "{left_out:?}");
        assert!(bare.pointer == "/links" && bare.detail.contains("no capsule for link 3"), "{bare:?}");
    }
}
