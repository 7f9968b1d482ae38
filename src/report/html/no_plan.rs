//! The report of a job that has no plan: the reasons with their counts, how the part would lie, and pictures of what
//! is in the way.

use std::borrow::Cow;

use nalgebra::{Point3, Vector2, Vector3};

use super::ReportSubject;
use super::album::Album;
use super::appendix;
use super::bodies::{Assembly, Placing};
use super::lay::{self, Lay};
use super::markup::{area, escape, grouped, nonzero, number, percent, prose};
use super::pictures::{self, SIZE_PX};
use super::verdict::{Figure, Standing, VerdictText};
use super::views::{swatch, three_sides};
use super::words;
use super::{sections, size};
use crate::cell::{Body, Cell, Configuration};
use crate::geometry::{Mesh, Part, Poll, Pose, Table, preview};
use crate::planning::context::{Cancelled, Context, NoPlan, PlanError};
use crate::planning::params::{PartParams, PlanParams, RegionParams};
use crate::planning::plan::{Advice, CandidateCounts, Cause, Obstruction, Turn, share};
use crate::planning::surface::{self, Surface};
use crate::planning::{PlanInput, resolve, resting};
use crate::rendering::{BodyRole, Camera, DrawnModel, Ink, MissGroup, SampledModel, Seen, Shading};
use crate::wire::words::{advice_sentence, apart_mm, exposure_remedy, first_lie, fixed, no_plan_sentence, rounded_up_mm};

/// Pairs of bodies that have pictures.
const PICTURED: usize = 4;
/// Triangles of a part that pictures show at most; a larger mesh is simplified.
const DRAWN_TRIANGLES: usize = 300_000;
/// Question in a refusal of a part for its implausible size.
const UNIT_QUESTION: &str = "times: is this the right unit?";
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

    /// Parameters with every default that a plan derives from part, scanner and cell, as the report of a plan lists them.
    pub(in crate::report) fn resolved(&self) -> PlanParams {
        let ReportSubject { mesh, fixture, part_sha256, scanner, cell, .. } = self.subject;
        resolve(self.params, &PlanInput { mesh, fixture, part_sha256, scanner, cell, roadmaps: None })
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

    /// Returns true if the part was refused for a size that no part has: nothing but the unit is wrong.
    fn is_of_implausible_size(&self) -> bool {
        matches!(self.reason, NoPlanReason::PartRefused(faults) if faults.iter().any(|fault| fault.contains(UNIT_QUESTION)))
    }

    /// The first thing to try, in a clause; `None` where the reason says it. It mends what most of the area is missed for.
    pub(in crate::report) fn first_step(&self) -> Option<String> {
        let (obstructions, missed_mm2, asked_mm2) = match self.reason {
            NoPlanReason::NoPlan(NoPlan::NothingMeasured { obstructions, missed_mm2, asked_mm2, .. }) => {
                (obstructions, missed_mm2, *asked_mm2)
            }
            NoPlanReason::NoPlan(_) => return None,
            NoPlanReason::PartRefused(_) if self.is_of_implausible_size() => {
                return Some("check the unit of the file".to_owned());
            }
            NoPlanReason::PartRefused(_) => {
                let remedy = self.subject.size_warnings.first().map(|warning| warning.remedy.clone());
                let other =
                    "check the unit of the file; lay the part another way (--up, part.table_from_part), or plan it in pieces";
                return Some(remedy.unwrap_or_else(|| other.to_owned()));
            }
        };
        // No change of the cell lets it measure what the part stands on.
        let lies = |cause: Cause| matches!(cause, Cause::ExcludedResting | Cause::Enclosed | Cause::FacesTable);
        let (cause, mm2) = missed_mm2.iter().find(|(cause, _)| !lies(*cause)).copied().unzip();
        Some(match (cause, most_blocking(obstructions)) {
            (Some(Cause::HiddenByCell), _) => {
                let hidden = mm2.map_or(0.0, |mm2| share(mm2, asked_mm2));
                format!("{}, which hides {} % of the asked area", self.clear_view(), number(100.0 * hidden, 0))
            }
            (Some(Cause::Unreachable), _) => {
                "move the table or the part closer to the robot; `vantage study reach` compares layouts".to_owned()
            }
            (Some(Cause::Exposure), _) => exposure_remedy(self.params.scan.brightness),
            (_, Some(obstruction)) => format!("{}: {}", obstruction.bodies, advice_sentence(&obstruction.advice)),
            (Some(Cause::Depth | Cause::FrameLeft | Cause::FrameRight | Cause::FrameProjector), None) => {
                "check the size of the part: was it read in the right unit?".to_owned()
            }
            (Some(Cause::IncidenceLeft | Cause::IncidenceRight | Cause::IncidenceProjector), None) => {
                let limits = &self.params.limits;
                let is_of_job = limits.camera_deg.is_some() || limits.projector_deg.is_some();
                let of_job = "allow a larger angle of incidence (limits.camera_deg, limits.projector_deg)";
                let own = "check the incidence limits in the scanner's specification (incidence_max_deg)";
                (if is_of_job { of_job } else { own }).to_owned()
            }
            (_, None) => "check the causes and the size of the part: was it read in the right unit?".to_owned(),
        })
    }

    /// The change that lets the scanner see past the obstacles of the cell, which it names.
    fn clear_view(&self) -> String {
        const NAMED: usize = 4;
        let obstacles = self.subject.cell.map_or(&[][..], |cell| &cell.obstacles);
        let names: Vec<&str> = obstacles.iter().filter(|body| !is_pedestal(body)).map(|body| body.name.as_str()).collect();
        let named = names[..names.len().min(NAMED)].join(", ");
        match names.len() {
            0 => "move or lower what stands in the cell".to_owned(),
            all if all > NAMED => format!("move or lower what stands in the cell ({named} and {} more)", all - NAMED),
            _ => format!("move or lower what stands in the cell ({named})"),
        }
    }

    /// Distance of the robot from the table beside its reach, in a sentence; `None` without a cell.
    pub(in crate::report) fn distance_sentence(&self) -> Option<String> {
        let cell = self.subject.cell?;
        let foot = cell.base_from_table.inverse().origin_mm();
        let (centre_mm, reach_mm) = cell.plate_centre_distance_mm();
        Some(format!(
            "The table's axis is {} mm from the robot's foot, and the plate's centre {} mm from the robot's shoulder; with the \
             arm fully extended, the scanner measures up to {} mm from the shoulder.",
            fixed(foot.x.hypot(foot.y), 0),
            fixed(centre_mm, 0),
            fixed(reach_mm, 0)
        ))
    }
}

/// Returns true if the robot stands on the body.
fn is_pedestal(body: &Body) -> bool {
    const TOUCHING_MM: f64 = 1.0;
    let aabb = body.surface().aabb();
    let is_below = |axis: usize| aabb.min[axis] < 0.0 && aabb.max[axis] > 0.0;
    aabb.max.z < TOUCHING_MM && is_below(0) && is_below(1)
}

/// The first of the pairs of bodies whose common advice would free most viewpoints.
fn most_blocking(obstructions: &[Obstruction]) -> Option<&Obstruction> {
    let blocked = |advice: &Advice| -> usize {
        let same = obstructions.iter().filter(|obstruction| obstruction.advice == *advice);
        same.map(|obstruction| obstruction.without_station + obstruction.without_path).sum()
    };
    // Of equal ones the last: it is the first of the pairs.
    obstructions.iter().rev().max_by_key(|obstruction| blocked(&obstruction.advice))
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
    let placed = input.params.part.table_from_part.as_ref();
    let lay = |(place, pose): (usize, &Pose<Table, Part>)| Lay {
        table_from_part: *pose,
        turn: turn(place),
        first_lie: first_lie(placed, pose),
    };
    let lays: Vec<Lay> = poses.iter().enumerate().map(lay).collect();
    let body = [
        sections::header(subject, "No scan plan", &[]),
        "<main>\n".to_owned(),
        // The refusal asks for the unit itself.
        if input.is_of_implausible_size() { String::new() } else { size::notices(subject.size_warnings) },
        verdict(input),
        in_the_way(input, &pictured, &poses[0], &mut album, ctx)?,
        // With every corner: its figures are exact.
        lay::section(subject, &lays, &mut album),
        reasons(input),
        format!(
            "<section class=\"appendix\">\n<h2>Appendix</h2>\n{}<h3>How it was planned</h3>\n{}<p>SHA-256 of the part’s file: {}.</p>\n\
             </section>\n",
            appendix::obstructions(input.obstructions()),
            appendix::parameters(&input.resolved()),
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
            "None of the viewpoints considered measures enough to be worth a view; the reasons are given below.".to_owned(),
            vec![
                Figure::new(number(candidates.generated as f64, 0), "viewpoints considered"),
                Figure::new(number(candidates.kept as f64, 0), "of them usable"),
            ],
        ),
        NoPlanReason::NoPlan(_) => ("No plan is possible", told(input), Vec::new()),
        NoPlanReason::PartRefused(_) => ("The part cannot be planned as it is", told(input), Vec::new()),
    };
    let stop = |step: &str| if step.ends_with('?') { "" } else { "." };
    let next = input.first_step().map_or_else(String::new, |step| prose(&format!("Try first: {step}{}", stop(&step))));
    let finding = VerdictText { standing: Standing::NoPlan, title: title.to_owned(), lines: vec![sentence], next, figures };
    format!("<section>\n{}</section>\n", finding.block())
}

fn told(input: &NoPlanInput<'_>) -> String {
    prose(&grouped(&format!("{}.", words::capitalised(&input.sentence()))))
}

/// Tables of what became of the viewpoints, and for what the surface is missed.
fn reasons(input: &NoPlanInput<'_>) -> String {
    let NoPlanReason::NoPlan(NoPlan::NothingMeasured { candidates, asked_mm2, missed_mm2, .. }) = input.reason else {
        return String::new();
    };
    format!(
        "<section>\n<h2>Why</h2>\n{}<h3>Why the surface is not measured</h3>\n<p>Each area is listed under what stopped the \
         viewpoint that came closest to measuring it.</p>\n<div class=\"card scroll\"><table>\n\
         <thead><tr><th>Cause</th><th class=\"n\">Area</th><th class=\"n\">Of asked</th></tr></thead>\n<tbody>\n{}</tbody></table></div>\n</section>\n",
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
    let reasons = candidates.rejected.iter().map(|(reason, count)| row(&words::rejection_name(*reason), reason.as_str(), *count));
    let rows: String = reasons.chain([row("Usable, but not worth a view", "kept", candidates.kept)]).collect();
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
            NoPlanReason::NoPlan(_) => "No collision keeps the robot from the viewpoints.",
            NoPlanReason::PartRefused(_) => "No viewpoint was tried.",
        };
        let distance = input.distance_sentence().map_or_else(String::new, |sentence| escape(&grouped(&sentence)));
        return Ok(format!(
            "<section>\n<h2>The part in the cell</h2>\n<p>The robot stands at home, the table at its home angle. {told} {distance}</p>\n\
             {picture}</section>\n"
        ));
    }
    let (first_step, kept) = (input.first_step(), Kept::of(input.params, cell));
    let figure = |obstruction: &&Obstruction| -> Result<String, Cancelled> {
        let blocked = obstruction.without_station + obstruction.without_path;
        let picture = pair(subject, cell, pose, &obstruction.configuration, Some(obstruction), ctx)?;
        let [a, b] = [&obstruction.bodies.a, &obstruction.bodies.b].map(|name| escape(name));
        let advice = advice_sentence(&obstruction.advice);
        // The first thing to try has been said above.
        let is_said = first_step.as_ref().is_some_and(|step| step.ends_with(&advice));
        let advice = if is_said { String::new() } else { format!(" What to do: {}.", prose(&advice)) };
        Ok(format!(
            "<h3>{}{a} and {}{b}: {} {}</h3>\n<p>{}{advice}</p>\n{picture}",
            swatch(Ink::Body(BodyRole::First)),
            swatch(Ink::Body(BodyRole::Second)),
            number(blocked as f64, 0),
            if blocked == 1 { "viewpoint" } else { "viewpoints" },
            kept.distance(obstruction)
        ))
    };
    // One after another: each makes a mesh of the whole cell.
    let figures = shown.iter().map(figure).collect::<Result<Vec<String>, Cancelled>>()?.concat();
    let legend = [Ink::Body(BodyRole::Part), Ink::Body(BodyRole::Other)];
    let legend: String = legend.iter().map(|ink| format!("<li>{}{}</li>", swatch(*ink), ink.label())).collect();
    Ok(format!(
        "<section class=\"blocked\">\n<h2>What is in the way</h2>\n<p>The pairs of bodies that block most viewpoints, each at one of these \
         viewpoints, from both sides of the table. The two bodies show through whatever hides them; a ring marks where they \
         meet. The arm is drawn as the capsules that are used to check collisions.</p>\n{figures}<ul class=\"legend\">{legend}</ul>\n\
         </section>\n"
    ))
}

/// Distance that two bodies have to keep.
struct Kept {
    clearance_mm: f64,
    /// Part of it that the plate may run out by, beside the clearance.
    runout_mm: f64,
}

impl Kept {
    fn of(params: &PlanParams, cell: &Cell) -> Self {
        Self { clearance_mm: params.motion.clearance_mm, runout_mm: cell.turntable.runout_displacement_mm() }
    }

    /// Distance or depth of the two at the viewpoint that is shown.
    fn distance(&self, obstruction: &Obstruction) -> String {
        let Self { clearance_mm, runout_mm } = self;
        let runout = match *runout_mm {
            none if none <= 0.0 => String::new(),
            some => format!(" plus {} mm for the plate’s runout", rounded_up_mm(some)),
        };
        let clearance = format!("closer than the clearance of {clearance_mm} mm{runout}");
        obstruction.separation.as_ref().map_or_else(String::new, |found| match found.distance_mm {
            depth if depth < 0.0 => format!("Here they overlap by {} mm.", nonzero(-depth, 1)),
            apart if apart < clearance_mm + runout_mm => format!("Here they are {} mm apart, {clearance}.", apart_mm(apart)),
            // Places on the way are looked at in steps.
            apart => format!("Here they are {} mm apart; on the way here they come {clearance}.", apart_mm(apart)),
        })
    }
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

    use nalgebra::Isometry3;

    use super::*;
    use crate::cell::{Contact, Presets, Separation, Shape, SpecLibrary};
    use crate::planning::context::Silent;
    use crate::testing::cylinder_mesh;
    use crate::wire::echo::Echo;
    use crate::wire::words::changed_params;

    /// 4.96 mm were told as 5.0 mm apart, "closer than the clearance" of 5 mm.
    #[test]
    fn a_distance_below_the_clearance_is_told_beside_it_and_as_below_it() {
        let told = |distance_mm: f64, runout_mm: f64| {
            let bodies = Contact { a: "forearm".into(), b: "part".into() };
            let separation = Separation { bodies: bodies.clone(), distance_mm, place_in_base_mm: Point3::origin() };
            let obstruction = Obstruction {
                bodies,
                without_station: 1,
                without_path: 0,
                configuration: Configuration { joints_rad: [0.0; 6], table_rad: 0.0 },
                separation: Some(separation),
                advice: Advice::TurnPart,
            };
            Kept { clearance_mm: 5.0, runout_mm }.distance(&obstruction)
        };
        assert_eq!(told(4.96, 0.0), "Here they are 4.9 mm apart, closer than the clearance of 5 mm.");
        let beside_runout = "Here they are 5.2 mm apart, closer than the clearance of 5 mm plus 0.370 mm for the plate’s runout.";
        assert_eq!(told(5.29, 0.37), beside_runout);
        let on_the_way = "Here they are 5.2 mm apart; on the way here they come closer than the clearance of 5 mm.";
        assert_eq!(told(5.29, 0.0), on_the_way);
        assert_eq!(told(-2.34, 0.0), "Here they overlap by 2.3 mm.");
    }

    #[test]
    fn the_first_step_mends_what_most_of_the_area_is_missed_for() {
        let mut cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
        let shape = Shape::Box { size_mm: [20.0, 900.0, 900.0] };
        cell.obstacles.push(Body { name: "guard".to_owned(), owner_from_body: Isometry3::translation(700.0, 0.0, 0.0), shape });
        let (mesh, echo, params) = (cylinder_mesh(30.0, 60.0, 24), Echo::default(), PlanParams::default());
        let subject = ReportSubject {
            mesh: &mesh,
            fixture: None,
            part_sha256: "",
            part_name: "post",
            scanner: &cell.scanner,
            cell: Some(&cell),
            echo: &echo,
            date: None,
            size_warnings: &[],
        };
        let step_of = |reason: NoPlanReason<'_>| NoPlanInput { subject, params: &params, reason }.first_step().expect("a step");
        let pair = |a: &str, b: &str, without_station: usize, advice: Advice| Obstruction {
            bodies: Contact { a: a.into(), b: b.into() },
            without_station,
            without_path: 0,
            configuration: cell.home_rad,
            separation: None,
            advice,
        };
        let step = |missed_mm2: Vec<(Cause, f64)>| {
            let guard = || Advice::MoveObstacle("guard".into());
            let finding = NoPlan::NothingMeasured {
                candidates: CandidateCounts::default(),
                asked_mm2: 100.0,
                missed_mm2,
                obstructions: vec![
                    pair("forearm", "wrist", 113, Advice::MoveFoot),
                    pair("forearm", "guard", 60, guard()),
                    pair("upper arm", "guard", 60, guard()),
                ],
                setups: Vec::new(),
            };
            step_of(NoPlanReason::NoPlan(&finding))
        };
        let hidden = step(vec![(Cause::HiddenByCell, 59.0), (Cause::Collision, 11.0)]);
        assert_eq!(
            hidden, "move or lower what stands in the cell (guard), which hides 59 % of the asked area",
            "not the pedestal"
        );
        let resting_first = step(vec![(Cause::ExcludedResting, 60.0), (Cause::Collision, 40.0)]);
        assert_eq!(resting_first, "forearm and guard: move guard, or the table away from it");
        assert!(step(vec![(Cause::Unreachable, 70.0)]).starts_with("move the table or the part closer to the robot"));
        let refused = |fault: &str| step_of(NoPlanReason::PartRefused(&[fault.to_owned()]));
        assert_eq!(refused("is 121000 mm wide; allowed is 150 times: is this the right unit?"), "check the unit of the file");
        assert!(refused("hangs over the plate").contains("plan it in pieces"));

        // Defaults that are derived are listed as in the report of a plan.
        let input = NoPlanInput { subject, params: &params, reason: NoPlanReason::PartRefused(&[]) };
        let listed = changed_params(&input.resolved());
        assert!(listed.iter().any(|(name, _)| name == "part.patch_edge_mm"), "{listed:?}");
        let distance = input.distance_sentence().expect("a cell");
        assert!(distance.starts_with("The table's axis is 400 mm from the robot's foot"), "{distance}");
    }

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
