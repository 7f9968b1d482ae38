//! Classification of a chain of joints by its closed form, read off its axes as they stand at zero: an ortho-parallel basis
//! with a spherical wrist (Brandstötter, Angerer and Hofbaur 2014, section 2), or three parallel axes followed by right angles
//! (Hawkins 2013, figure 1). Lengths are mm.
//!
//! The chain may be off by what files round and by what a maker's calibration adds ([`APART_MM`], [`TILTED`]): its own steps
//! make good for that.

use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::chain::Chain;
use super::opw::{self, Opw};
use super::ur::{self, UrSpec};
use super::{LinkFrames, principal};
use crate::geometry::Pose;

/// Axes that are to meet may pass each other this closely, mm.
const APART_MM: f64 = 5.0;
/// Cosine between axes that are to be at right angles; sine between those that are to be parallel.
const TILTED: f64 = 0.02;
/// Shoulder × elbow × wrist.
const BRANCHES: usize = 8;
/// Distance beyond the model's reach, as a share of it, at which steps still begin: the chain may reach a little further.
const NEAR: f64 = 0.05;
/// Joint vectors at which form and chain are compared, radians.
const COMPARED_RAD: [[f64; 6]; 2] = [[0.0; 6], [0.7, -0.5, 0.9, -1.1, 0.6, 1.3]];

/// A closed form that a chain has, and how it is set into the chain.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ClosedForm {
    base_from_model: Isometry3<f64>,
    model_flange_from_flange: Isometry3<f64>,
    model: Model,
}

#[derive(Clone, Debug, PartialEq)]
enum Model {
    Opw(Opw),
    Ur { arm: UrSpec, signs: [f64; 6], zero_rad: [f64; 6] },
}

impl ClosedForm {
    pub(super) fn name(&self) -> &'static str {
        match self.model {
            Model::Opw(_) => "opw",
            Model::Ur { .. } => "ur",
        }
    }

    /// Starts for the steps of a chain: every solution of the model, and near misses where it lacks some.
    pub(super) fn inverse(&self, base_from_flange: &Isometry3<f64>) -> Vec<[f64; 6]> {
        let wanted = self.base_from_model.inverse() * base_from_flange * self.model_flange_from_flange.inverse();
        let mut begin = self.model.inverse(&wanted, 0.0);
        if begin.len() < BRANCHES {
            begin.extend(self.model.inverse(&wanted, NEAR));
        }
        begin
    }

    fn flange(&self, joints_rad: &[f64; 6]) -> Isometry3<f64> {
        self.base_from_model * self.model.frames(joints_rad)[6] * self.model_flange_from_flange
    }

    /// Sets the model so that its flange stands where the chain's does at zero, and checks that it stays with it.
    fn fitted(base_from_model: Isometry3<f64>, model: Model, chain: &Chain) -> Option<Self> {
        let model_flange = base_from_model * model.frames(&[0.0; 6])[6];
        let model_flange_from_flange = model_flange.inverse() * chain.link_frames(&[0.0; 6])[6];
        let form = Self { base_from_model, model_flange_from_flange, model };
        let fits = |joints: &[f64; 6]| {
            let (found, wanted) = (form.flange(joints), chain.link_frames(joints)[6]);
            (found.translation.vector - wanted.translation.vector).norm() < 4.0 * APART_MM
                && found.rotation.angle_to(&wanted.rotation) < 4.0 * TILTED
        };
        COMPARED_RAD.iter().all(fits).then_some(form)
    }
}

impl Model {
    fn inverse(&self, base_from_flange: &Isometry3<f64>, beyond: f64) -> Vec<[f64; 6]> {
        match self {
            Self::Opw(arm) => arm.inverse(&Pose::claim(*base_from_flange), opw::COSINE_SLACK + beyond),
            Self::Ur { arm, signs, zero_rad } => ur::inverse(arm, base_from_flange, ur::SLACK + beyond)
                .into_iter()
                .map(|theta| std::array::from_fn(|joint| principal(signs[joint] * (theta[joint] - zero_rad[joint]))))
                .collect(),
        }
    }

    fn frames(&self, joints_rad: &[f64; 6]) -> LinkFrames {
        match self {
            Self::Opw(arm) => arm.link_frames(joints_rad),
            Self::Ur { arm, signs, zero_rad } => {
                ur::link_frames(arm, &std::array::from_fn(|joint| signs[joint] * joints_rad[joint] + zero_rad[joint]))
            }
        }
    }
}

/// The closed form of a chain, if it has one.
pub(super) fn classify(chain: &Chain) -> Option<ClosedForm> {
    ortho_parallel(chain).or_else(|| three_parallel(chain))
}

/// A joint's axis as it stands at zero: a point on it, and its direction.
#[derive(Clone, Copy, Debug)]
struct Line {
    at: Point3<f64>,
    along: Vector3<f64>,
}

impl Line {
    fn is_across(&self, other: &Self) -> bool {
        self.along.dot(&other.along).abs() < TILTED
    }

    fn is_parallel(&self, other: &Self) -> bool {
        self.along.cross(&other.along).norm() < TILTED
    }

    /// Distance of a point from the line.
    fn distance_mm(&self, point: &Point3<f64>) -> f64 {
        (point - self.at).cross(&self.along).norm()
    }

    /// The meeting point of two lines that are not parallel, or the middle between them if they pass closely.
    fn meeting(&self, other: &Self) -> Option<Point3<f64>> {
        let normal = self.along.cross(&other.along);
        let between = other.at - self.at;
        let square = normal.norm_squared();
        let here = self.at + self.along * (between.cross(&other.along).dot(&normal) / square);
        let there = other.at + other.along * (between.cross(&self.along).dot(&normal) / square);
        ((here - there).norm() < APART_MM).then(|| nalgebra::center(&here, &there))
    }
}

/// The axes in a frame with +z along axis 1, its origin on it at the height of the foot, and +y along `y_sign` times
/// axis 2; with that frame in the base, and the flange's origin. `None` where axes 1 and 2 are not at right angles.
fn axes(chain: &Chain, y_sign: f64) -> Option<(Isometry3<f64>, [Line; 6], Point3<f64>)> {
    let frames = chain.link_frames(&[0.0; 6]);
    let flange = Point3::from(frames[6].translation.vector);
    let directions = chain.joint_axes();
    let lines: [Line; 6] = std::array::from_fn(|joint| Line {
        at: Point3::from(if joint == 5 {
            (frames[6] * chain.flange.inverse()).translation.vector
        } else {
            frames[joint + 1].translation.vector
        }),
        along: frames[joint + 1].rotation * Vector3::from(directions[joint]),
    });
    if !lines[0].is_across(&lines[1]) {
        return None;
    }
    let z = lines[0].along;
    let y = (y_sign * (lines[1].along - z * z.dot(&lines[1].along))).normalize();
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_basis_unchecked(&[y.cross(&z), y, z]));
    let origin = lines[0].at - z * lines[0].at.coords.dot(&z);
    let base_from_model = Isometry3::from_parts(Translation3::from(origin.coords), rotation);
    let into = base_from_model.inverse();
    let lines = lines.map(|line| Line { at: into * line.at, along: into * line.along });
    Some((base_from_model, lines, into * flange))
}

fn ortho_parallel(chain: &Chain) -> Option<ClosedForm> {
    let (base_from_model, [_, two, three, four, five, six], flange) = axes(chain, 1.0)?;
    let wrist = five.meeting(&six).filter(|wrist| four.distance_mm(wrist) < APART_MM)?;
    if !(three.is_parallel(&two) && four.is_across(&three) && four.is_across(&five) && five.is_across(&six)) {
        return None;
    }
    // Seen along axes 2 and 3, in the plane through the wrist.
    let shoulder = Point3::new(two.at.x, wrist.y, two.at.z);
    let elbow = Point3::new(three.at.x, wrist.y, three.at.z);
    let (upper, fore) = (elbow - shoulder, wrist - elbow);
    let sign4 = if fore.dot(&four.along) < 0.0 { -1.0 } else { 1.0 };
    let theta2 = upper.x.atan2(upper.z);
    let theta23 = (sign4 * four.along.x).atan2(sign4 * four.along.z);
    let (x3, z3) = (Vector3::new(theta23.cos(), 0.0, -theta23.sin()), Vector3::new(theta23.sin(), 0.0, theta23.cos()));
    let theta4 = (-five.along.dot(&x3)).atan2(five.along.y);
    let x4 = x3 * theta4.cos() + Vector3::y() * theta4.sin();
    let theta5 = six.along.dot(&x4).atan2(six.along.dot(&z3));
    let zero_rad = [0.0, theta2, theta23 - theta2, theta4, theta5, 0.0];
    let arm = Opw {
        a1_mm: shoulder.x,
        a2_mm: fore.dot(&x3),
        b_mm: wrist.y,
        c1_mm: shoulder.z,
        c2_mm: upper.norm(),
        c3_mm: fore.dot(&z3),
        c4_mm: (flange - wrist).dot(&six.along),
        signs: [1.0, 1.0, three.along.y.signum(), sign4, 1.0, 1.0],
        offsets_rad: zero_rad.map(|angle| -angle),
        joint_3_from_ground: false,
    };
    ClosedForm::fitted(base_from_model, Model::Opw(arm), chain)
}

fn three_parallel(chain: &Chain) -> Option<ClosedForm> {
    // At zero the model's axis 2 looks along −y.
    let (base_from_model, [_, two, three, four, five, six], flange) = axes(chain, -1.0)?;
    if !(three.is_parallel(&two) && four.is_parallel(&two) && five.is_across(&four) && six.is_across(&five)) {
        return None;
    }
    let d4_mm = -five.at.y;
    let in_plane = |line: &Line| Point3::new(line.at.x, -d4_mm, line.at.z);
    let (shoulder, elbow, beyond) = (in_plane(&two), in_plane(&three), in_plane(&four));
    if shoulder.x.abs() > APART_MM || five.distance_mm(&beyond) > APART_MM {
        return None;
    }
    let last = five.meeting(&six)?;
    let angle = |along: Vector3<f64>| along.z.atan2(along.x);
    let (upper, fore) = (elbow - shoulder, beyond - elbow);
    let whole = five.along.x.atan2(-five.along.z);
    let x4 = Vector3::new(whole.cos(), 0.0, whole.sin());
    let theta5 = (-six.along.dot(&x4)).atan2(-six.along.y);
    let arm = UrSpec {
        d1_mm: shoulder.z,
        a2_mm: upper.norm(),
        a3_mm: fore.norm(),
        d4_mm,
        d5_mm: (last - beyond).dot(&five.along),
        d6_mm: (flange - last).dot(&six.along),
    };
    let signs = [1.0, 1.0, -three.along.y.signum(), -four.along.y.signum(), 1.0, 1.0];
    let zero_rad = [0.0, angle(upper), angle(fore) - angle(upper), whole - angle(fore), theta5, 0.0];
    (arm.a2_mm > 1.0 && arm.a3_mm > 1.0).then_some(())?;
    ClosedForm::fitted(base_from_model, Model::Ur { arm, signs, zero_rad }, chain)
}
