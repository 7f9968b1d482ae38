//! The report of a job that has no plan: the reasons with their counts, how the part would lie, and pictures of what
//! is in the way.

use std::borrow::Cow;

use nalgebra::{Point3, Vector2, Vector3};

use super::ReportSubject;
use super::album::Album;
use super::appendix;
use super::bodies::{Assembly, Placing};
use super::camera::Camera;
use super::lay::{self, Lay};
use super::markup::{area, escape, number, percent};
use super::model::{DrawnModel, SampledModel};
use super::palette::{BodyRole, Ink, MissGroup};
use super::pictures::{self, SIZE_PX};
use super::renderer::Seen;
use super::shading::Shading;
use super::verdict::{Figure, Standing, VerdictText};
use super::views::{swatch, three_sides};
use super::words;
use super::{sections, size};
use crate::cell::{Cell, Configuration};
use crate::geometry::{Mesh, Part, Poll, Pose, Table, preview};
use crate::planning::context::{Cancelled, Context, NoPlan, PlanError};
use crate::planning::params::{PartParams, PlanParams, RegionParams};
use crate::planning::plan::{CandidateCounts, Cause, Obstruction, Turn, share};
use crate::planning::resting;
use crate::planning::surface::{self, Surface};
use crate::wire::words::{advice_sentence, no_plan_sentence};

/// Pairs of bodies that have pictures.
const PICTURED: usize = 4;
/// Triangles of a part that pictures show at most; a larger mesh is simplified.
const DRAWN_TRIANGLES: usize = 300_000;
/// Radius of the ring around the place where two bodies meet, pixels.
const RING_PX: f64 = 26.0;

/// Reason why a job has no plan.
#[derive(Clone, Copy)]
pub enum NoPlanReason<'a> {
    /// No plan is possible.
    NoPlan(&'a NoPlan),
    /// The part does not suit plate or scanner: what is wrong with it, a sentence each.
    PartRefused(&'a [String]),
}

/// Input of the report of a job that has no plan.
#[derive(Clone, Copy)]
pub struct NoPlanInput<'a> {
    /// The part and what it was planned for.
    pub subject: ReportSubject<'a>,
    /// Parameters as given.
    pub params: &'a PlanParams,
    /// The reason.
    pub reason: NoPlanReason<'a>,
}

impl NoPlanInput<'_> {
    /// Poses in which the part was to lie.
    fn poses(&self) -> Vec<Pose<Table, Part>> {
        match self.reason {
            NoPlanReason::NoPlan(NoPlan::NothingMeasured { setups, .. }) if !setups.is_empty() => setups.clone(),
            NoPlanReason::NoPlan(_) | NoPlanReason::PartRefused(_) => {
                let given = self.params.part.table_from_part.map(|pose| pose.pose());
                vec![given.unwrap_or_else(|| resting(self.subject.mesh))]
            }
        }
    }

    fn obstructions(&self) -> &[Obstruction] {
        match self.reason {
            NoPlanReason::NoPlan(NoPlan::NothingMeasured { obstructions, .. }) => obstructions,
            NoPlanReason::NoPlan(_) | NoPlanReason::PartRefused(_) => &[],
        }
    }

    /// The reason in a sentence without a full stop.
    pub(in crate::report) fn sentence(&self) -> String {
        match self.reason {
            NoPlanReason::NoPlan(finding) => format!("no plan is possible: {}", no_plan_sentence(finding)),
            NoPlanReason::PartRefused(faults) => format!("the part cannot be planned: it {}", faults.join("; it ")),
        }
    }

    /// The first thing to try, in a clause; `None` where the reason says it.
    pub(in crate::report) fn first_step(&self) -> Option<String> {
        let (obstructions, missed_mm2) = match self.reason {
            NoPlanReason::NoPlan(NoPlan::NothingMeasured { obstructions, missed_mm2, .. }) => (obstructions, missed_mm2),
            NoPlanReason::NoPlan(_) => return None,
            NoPlanReason::PartRefused(_) => {
                let remedy = self.subject.size_warnings.first().map(|warning| warning.remedy.clone());
                let other =
                    "check the unit of the file; lay the part another way (--up, part.table_from_part), or plan it in pieces";
                return Some(remedy.unwrap_or_else(|| other.to_owned()));
            }
        };
        Some(match (obstructions.first(), missed_mm2.first()) {
            (Some(obstruction), _) => format!("{}: {}", obstruction.bodies, advice_sentence(&obstruction.advice)),
            (None, Some((Cause::Unreachable, _))) => {
                "set the table nearer to the robot, or the part nearer to it; `vantage study reach` compares places".to_owned()
            }
            (None, Some((Cause::Depth | Cause::FrameLeft | Cause::FrameRight | Cause::FrameProjector, _))) => {
                "look at the size of the part: was it read in the right unit?".to_owned()
            }
            (None, Some((Cause::IncidenceLeft | Cause::IncidenceRight | Cause::IncidenceProjector, _))) => {
                "allow a larger angle of incidence (limits.camera_deg, limits.projector_deg)".to_owned()
            }
            (None, _) => "look at the causes, and at the size of the part: was it read in the right unit?".to_owned(),
        })
    }
}

/// Renders the page. Pictures show a simplified mesh of a large part, so that memory is bounded.
///
/// # Errors
/// [`Cancelled`].
pub fn render_no_plan(input: &NoPlanInput<'_>, ctx: &Context<'_>) -> Result<String, Cancelled> {
    let (subject, poses) = (&input.subject, input.poses());
    let (part, fixture) = (drawn(subject.mesh, ctx)?, subject.fixture.map(|fixture| drawn(fixture, ctx)).transpose()?);
    let pictured = ReportSubject { mesh: &part, fixture: fixture.as_deref(), ..*subject };
    let surface = facets(&part, ctx)?;
    let mut album = Album::new(SampledModel::new(&part, &surface, None, ctx)?);
    let turn = |place: usize| (place > 0).then(|| Turn::between(&poses[0], &poses[place]));
    let lays: Vec<Lay> =
        poses.iter().enumerate().map(|(place, pose)| Lay { table_from_part: *pose, turn: turn(place) }).collect();
    let body = [
        sections::header(subject, "No scan plan"),
        "<main>\n".to_owned(),
        size::notices(subject.size_warnings),
        verdict(input),
        in_the_way(input, &pictured, &poses[0], &mut album, ctx)?,
        // With every corner: its figures are exact.
        lay::section(subject, &lays, &mut album),
        reasons(input),
        format!(
            "<section class=\"appendix\">\n<h2>Appendix</h2>\n{}<h3>How it was planned</h3>\n{}<p>SHA-256 of the part’s file: {}.</p>\n\
             </section>\n",
            appendix::obstructions(input.obstructions()),
            appendix::parameters(input.params),
            sections::digest(subject.part_sha256)
        ),
        "</main>\n".to_owned(),
        sections::footer("what was found while planning"),
    ];
    album.into_draft(sections::document(subject, "No scan plan", &body.concat())).draw(ctx)
}

/// The mesh that pictures show: the mesh itself, or a simplified one where it is large.
fn drawn<'a>(mesh: &'a Mesh, ctx: &Context<'_>) -> Result<Cow<'a, Mesh>, Cancelled> {
    if mesh.faces.len() <= DRAWN_TRIANGLES {
        return Ok(Cow::Borrowed(mesh));
    }
    let stop = || ctx.check().is_err();
    let preview = preview(mesh, DRAWN_TRIANGLES, &Poll::new(&stop))?;
    let vertices_mm = preview.positions_mm.iter().map(|position| Point3::from(position.map(f64::from))).collect();
    let mut drawn = Mesh { vertices_mm, faces: preview.faces, source_face: Vec::new(), groups: Vec::new() };
    let kept: Vec<[u32; 3]> =
        (0..drawn.faces.len()).filter(|face| drawn.face_area_mm2(*face) > 0.0).map(|face| drawn.faces[face]).collect();
    drawn.source_face = (0..).take(kept.len()).collect();
    drawn.faces = kept;
    Ok(Cow::Owned(drawn))
}

/// A surface of one sample a facet, for pictures alone.
fn facets(mesh: &Mesh, ctx: &Context<'_>) -> Result<Surface, Cancelled> {
    let whole = PartParams { patch_edge_mm: Some(f64::INFINITY), samples_per_mm2: Some(0.0), ..PartParams::default() };
    match surface::sample_for(mesh, &whole, &RegionParams::default(), 0, ctx) {
        Ok(surface) => Ok(surface),
        Err(PlanError::Cancelled) => Err(Cancelled),
        // Nothing is asked of it that could fail; without it, pictures are empty.
        Err(PlanError::BadParams(_) | PlanError::NoPlan(_)) => Ok(Surface::default()),
    }
}

fn verdict(input: &NoPlanInput<'_>) -> String {
    let (title, sentence, figures) = match input.reason {
        NoPlanReason::NoPlan(NoPlan::NothingMeasured { candidates, .. }) => (
            "No plan is possible",
            "None of the viewpoints that were considered measures anything worth a view: see below what became of them."
                .to_owned(),
            vec![
                Figure::new(number(candidates.generated as f64, 0), "viewpoints considered"),
                Figure::new(number(candidates.kept as f64, 0), "of them usable"),
            ],
        ),
        NoPlanReason::NoPlan(_) => ("No plan is possible", told(input), Vec::new()),
        NoPlanReason::PartRefused(_) => ("The part cannot be planned as it is", told(input), Vec::new()),
    };
    let stop = |step: &str| if step.ends_with('?') { "" } else { "." };
    let next = input.first_step().map_or_else(String::new, |step| escape(&format!("Try first: {step}{}", stop(&step))));
    let finding = VerdictText { standing: Standing::NoPlan, title: title.to_owned(), lines: vec![sentence], next, figures };
    format!("<section>\n{}</section>\n", finding.block())
}

fn told(input: &NoPlanInput<'_>) -> String {
    escape(&format!("{}.", words::capitalised(&input.sentence())))
}

/// Tables of what became of the viewpoints, and for what the surface is missed.
fn reasons(input: &NoPlanInput<'_>) -> String {
    let NoPlanReason::NoPlan(NoPlan::NothingMeasured { candidates, asked_mm2, missed_mm2, .. }) = input.reason else {
        return String::new();
    };
    format!(
        "<section>\n<h2>Why</h2>\n{}<h3>What the surface lacks</h3>\n<p>By what stopped the viewpoint that came closest to measuring \
         it.</p>\n<div class=\"card scroll\"><table>\n<thead><tr><th>Cause</th><th class=\"n\">Area</th><th class=\"n\">Of asked</th>\
         </tr></thead>\n<tbody>\n{}</tbody></table></div>\n</section>\n",
        dropped(candidates),
        missed_mm2.iter().map(|missed| missed_row(input, *missed, *asked_mm2)).collect::<String>()
    )
}

fn missed_row(input: &NoPlanInput<'_>, (cause, mm2): (Cause, f64), asked_mm2: f64) -> String {
    format!(
        "<tr><td>{}<b>{}</b> <code>{}</code><br/><span class=\"soft\">{}</span></td><td class=\"n\">{}</td><td class=\"n\">{}</td></tr>\n",
        swatch(Ink::Missed(MissGroup::of(cause))),
        words::cause_name(cause),
        cause.as_str(),
        words::cause_meaning(cause, input.subject.scanner, input.params),
        area(mm2),
        percent(share(mm2, asked_mm2))
    )
}

fn dropped(candidates: &CandidateCounts) -> String {
    let row = |name: &str, code: &str, count: usize| {
        let count = number(count as f64, 0);
        format!("<tr><td><b>{name}</b> <code>{code}</code></td><td class=\"n\">{count}</td></tr>\n")
    };
    let reasons = candidates.rejected.iter().map(|(reason, count)| row(words::rejection_name(*reason), reason.as_str(), *count));
    let rows: String = reasons.chain([row("Usable, but they measure nothing worth a view", "kept", candidates.kept)]).collect();
    format!(
        "<h3>What became of the viewpoints</h3>\n<div class=\"card scroll\"><table>\n<thead><tr><th>{} viewpoints considered</th>\
         <th class=\"n\">Number</th></tr></thead>\n<tbody>\n{rows}</tbody></table></div>\n",
        number(candidates.generated as f64, 0)
    )
}

/// Pictures of what is in the way; of the cell at home where that is nothing, and of the part alone without a cell.
fn in_the_way(
    input: &NoPlanInput<'_>,
    subject: &ReportSubject<'_>,
    pose: &Pose<Table, Part>,
    album: &mut Album,
    ctx: &Context<'_>,
) -> Result<String, Cancelled> {
    let Some(cell) = subject.cell else {
        let sides = three_sides(|side| pictures::plain(subject, album, *pose, side));
        return Ok(format!("<section>\n<h2>The part</h2>\n{sides}</section>\n"));
    };
    let shown: Vec<&Obstruction> = input.obstructions().iter().take(PICTURED).collect();
    if shown.is_empty() {
        let picture = pair(subject, cell, pose, &cell.home_rad, None, ctx)?;
        let told = match input.reason {
            NoPlanReason::NoPlan(_) => " No collision keeps the robot from the viewpoints.",
            NoPlanReason::PartRefused(_) => " No viewpoint was tried.",
        };
        return Ok(format!(
            "<section>\n<h2>The part in the cell</h2>\n<p>The robot stands at home, the table at its home angle.{told}</p>\n\
             {picture}</section>\n"
        ));
    }
    let figure = |obstruction: &&Obstruction| -> Result<String, Cancelled> {
        let blocked = obstruction.without_station + obstruction.without_path;
        let picture = pair(subject, cell, pose, &obstruction.configuration, Some(obstruction), ctx)?;
        let [a, b] = [&obstruction.bodies.a, &obstruction.bodies.b].map(|name| escape(name));
        Ok(format!(
            "<h3>{}{a} and {}{b}: {} {}</h3>\n<p>{}{}.</p>\n{picture}",
            swatch(Ink::Body(BodyRole::First)),
            swatch(Ink::Body(BodyRole::Second)),
            number(blocked as f64, 0),
            if blocked == 1 { "viewpoint" } else { "viewpoints" },
            distance(obstruction),
            escape(&advice_sentence(&obstruction.advice))
        ))
    };
    // One after another: each makes a mesh of the whole cell.
    let figures = shown.iter().map(figure).collect::<Result<Vec<String>, Cancelled>>()?.concat();
    let legend = [Ink::Body(BodyRole::Part), Ink::Body(BodyRole::Other)];
    let legend: String = legend.iter().map(|ink| format!("<li>{}{}</li>", swatch(*ink), ink.label())).collect();
    Ok(format!(
        "<section class=\"blocked\">\n<h2>What is in the way</h2>\n<p>The pairs of bodies that keep the cell from most viewpoints, each at \
         one of these viewpoints, from both sides of the table. The two shine through what hides them; a ring marks where they \
         meet. The arm is drawn as the capsules that collisions are tested with.</p>\n{figures}<ul class=\"legend\">{legend}</ul>\n\
         </section>\n"
    ))
}

/// Distance or depth of the two at the viewpoint that is shown.
fn distance(obstruction: &Obstruction) -> String {
    obstruction.separation.as_ref().map_or_else(String::new, |found| match found.distance_mm {
        depth if depth < 0.0 => format!("{} mm deep in each other here. What to do: ", number(-depth, 1)),
        apart => format!("{} mm apart here, closer than the clearance. What to do: ", number(apart, 1)),
    })
}

/// The cell at a configuration from both sides of the table.
fn pair(
    subject: &ReportSubject<'_>,
    cell: &Cell,
    pose: &Pose<Table, Part>,
    configuration: &Configuration,
    obstruction: Option<&Obstruction>,
    ctx: &Context<'_>,
) -> Result<String, Cancelled> {
    let names = obstruction.map(|obstruction| [&*obstruction.bodies.a, &*obstruction.bodies.b]);
    let assembly = Assembly::at(subject, cell, &Placing { table_from_part: pose, configuration, in_the_way: names }, ctx)?;
    let model = DrawnModel::of_mesh(&assembly.mesh, ctx)?;
    let shading = Shading::new(&model);
    let inks: Vec<u8> = assembly.inks.iter().map(|ink| ink.code()).collect();
    let foot = cell.base_from_table.origin_mm().xy().coords;
    let away = foot.try_normalize(1e-6).unwrap_or(Vector2::x());
    let alt = match names {
        Some([a, b]) => format!("The cell where {a} and {b} meet"),
        None => "The part in the cell, with the robot at home".to_owned(),
    };
    let figure = |side: f64| -> Result<String, Cancelled> {
        ctx.check()?;
        let towards = Vector3::new(0.4 * away.x - side * away.y, 0.4 * away.y + side * away.x, 0.6);
        let camera = Camera::looking_at(&assembly.focus_mm, towards, Vector3::z(), SIZE_PX);
        let place = obstruction.and_then(|obstruction| obstruction.separation.as_ref()).map(|found| found.place_in_base_mm);
        let ring = place
            .and_then(|place_mm| camera.pixel(&camera.camera_from_part.point(&place_mm)))
            .map_or_else(String::new, |[x, y]| format!("<circle class=\"ring\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{RING_PX}\"/>"));
        let image = Seen::new(&model, &camera, ctx.simd_level()).picture(&shading, &inks, true);
        Ok(format!("<figure>{}</figure>\n", pictures::overlaid(SIZE_PX, &image.data_uri(), &alt, &ring)))
    };
    let figures = [-1.0, 1.0].map(figure).into_iter().collect::<Result<String, Cancelled>>()?;
    Ok(format!("<div class=\"grid2\">\n{figures}</div>\n"))
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::planning::context::Silent;
    use crate::testing::cylinder_mesh;

    #[test]
    fn a_large_part_is_pictured_by_a_simplified_mesh_and_a_cancel_is_heard() {
        let cancel = AtomicBool::new(false);
        let ctx = Context::new(&cancel, &Silent);
        let small = cylinder_mesh(30.0, 60.0, 24);
        assert!(matches!(drawn(&small, &ctx), Ok(Cow::Borrowed(_))));
        // Four triangles a side.
        let large = cylinder_mesh(300.0, 600.0, 100_000);
        let simplified = drawn(&large, &ctx).expect("not cancelled");
        let count = simplified.faces.len();
        assert!(count > 100 && count <= DRAWN_TRIANGLES && simplified.source_face.len() == count, "{count} triangles");
        assert!((simplified.aabb().extent_mm() - large.aabb().extent_mm()).norm() < 6.0, "{:?}", simplified.aabb());
        assert_eq!(facets(&simplified, &ctx).expect("not cancelled").patches.len(), count);
        cancel.store(true, std::sync::atomic::Ordering::Relaxed);
        assert!(drawn(&large, &ctx).is_err() && facets(&small, &ctx).is_err());
    }
}
