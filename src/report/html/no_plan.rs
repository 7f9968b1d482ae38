//! The report of a job for which no plan is possible: the reasons with their counts, how the part would lie, and pictures of what
//! is in the way.

use nalgebra::{Vector2, Vector3};

use super::ReportSubject;
use super::album::Album;
use super::appendix;
use super::bodies::Assembly;
use super::camera::Camera;
use super::lay::{self, Lay};
use super::markup::{area, escape, number, percent};
use super::model::{Model, SampledModel};
use super::palette::{BodyRole, Ink, MissGroup};
use super::pictures::{self, SIZE_PX};
use super::renderer::Seen;
use super::sections;
use super::shading::Shading;
use super::verdict::{Figure, Standing, VerdictText};
use super::views::{swatch, three_sides};
use super::words;
use crate::cell::{Cell, Configuration};
use crate::geometry::{Mesh, Part, Pose, Table};
use crate::planning::context::{Cancelled, Context, NoPlan};
use crate::planning::params::{PartParams, PlanParams, RegionParams};
use crate::planning::plan::{CandidateCounts, Cause, Obstruction, Turn, share};
use crate::planning::resting;
use crate::planning::surface::{self, Surface};
use crate::wire::words::{advice_sentence, no_plan_sentence};

/// Pairs of bodies that have pictures.
const PICTURED: usize = 4;
/// Radius of the ring around the place where two bodies meet, pixels.
const RING_PX: f64 = 26.0;

/// Input of the report of a job for which no plan is possible.
#[derive(Clone, Copy)]
pub struct NoPlanInput<'a> {
    /// The part and what it was planned for.
    pub subject: ReportSubject<'a>,
    /// Parameters as given.
    pub params: &'a PlanParams,
    /// The reasons.
    pub finding: &'a NoPlan,
}

impl NoPlanInput<'_> {
    /// Poses in which the part was to lie.
    fn poses(&self) -> Vec<Pose<Table, Part>> {
        match self.finding {
            NoPlan::NothingMeasured { setups, .. } if !setups.is_empty() => setups.clone(),
            NoPlan::NothingMeasured { .. } | NoPlan::NotRegistered { .. } | NoPlan::NothingInStudy => {
                let given = self.params.part.table_from_part.map(|pose| pose.pose());
                vec![given.unwrap_or_else(|| resting(self.subject.mesh))]
            }
        }
    }

    fn obstructions(&self) -> &[Obstruction] {
        match self.finding {
            NoPlan::NothingMeasured { obstructions, .. } => obstructions,
            NoPlan::NotRegistered { .. } | NoPlan::NothingInStudy => &[],
        }
    }
}

/// Renders the page.
///
/// # Errors
/// [`Cancelled`].
pub fn render_no_plan(input: &NoPlanInput<'_>, ctx: &Context<'_>) -> Result<String, Cancelled> {
    let (subject, poses) = (&input.subject, input.poses());
    let surface = facets(subject.mesh);
    let mut album = Album::new(SampledModel::new(subject.mesh, &surface, None, ctx)?);
    let turn = |place: usize| (place > 0).then(|| Turn::between(&poses[0], &poses[place]));
    let lays: Vec<Lay> =
        poses.iter().enumerate().map(|(place, pose)| Lay { table_from_part: *pose, turn: turn(place) }).collect();
    let body = [
        sections::header(subject, "No scan plan"),
        "<main>\n".to_owned(),
        verdict(input),
        in_the_way(input, &poses[0], &mut album, ctx)?,
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

/// A surface of one sample a facet, for pictures alone.
fn facets(mesh: &Mesh) -> Surface {
    let whole = PartParams { patch_edge_mm: Some(f64::INFINITY), samples_per_mm2: Some(0.0), ..PartParams::default() };
    // Nothing is asked of it that could fail; without it, pictures are empty.
    surface::sample(mesh, &whole, &RegionParams::default(), 0).unwrap_or_default()
}

fn verdict(input: &NoPlanInput<'_>) -> String {
    let (sentence, figures) = match input.finding {
        NoPlan::NothingMeasured { candidates, .. } => (
            "None of the viewpoints that were considered measures anything worth a view: see below what became of them."
                .to_owned(),
            vec![
                Figure::new(number(candidates.generated as f64, 0), "viewpoints considered"),
                Figure::new(number(candidates.kept as f64, 0), "of them usable"),
            ],
        ),
        NoPlan::NotRegistered { .. } | NoPlan::NothingInStudy => {
            (escape(&format!("No plan is possible: {}.", no_plan_sentence(input.finding))), Vec::new())
        }
    };
    let finding =
        VerdictText { standing: Standing::NoPlan, title: "No plan is possible".to_owned(), lines: vec![sentence], figures };
    format!("<section>\n{}{}</section>\n", finding.block(), first_step(input))
}

/// The first thing to try.
fn first_step(input: &NoPlanInput<'_>) -> String {
    let step = match input.finding {
        NoPlan::NothingMeasured { obstructions, missed_mm2, .. } => match (obstructions.first(), missed_mm2.first()) {
            (Some(obstruction), _) => format!("{}: {}", obstruction.bodies, advice_sentence(&obstruction.advice)),
            (None, Some((Cause::Unreachable, _))) => {
                "set the table nearer to the robot, or the part nearer to it; `vantage study reach` compares places".to_owned()
            }
            (None, Some((Cause::Depth | Cause::FrameLeft | Cause::FrameRight | Cause::FrameProjector, _))) => {
                "look at the size above: was the part read in the right unit?".to_owned()
            }
            (None, _) => "look at the causes below, and at the size above: was the part read in the right unit?".to_owned(),
        },
        NoPlan::NotRegistered { .. } | NoPlan::NothingInStudy => return String::new(),
    };
    format!("<p class=\"action\"><b>Try first:</b> {}.</p>\n", escape(&step))
}

/// Tables of what became of the viewpoints, and for what the surface is missed.
fn reasons(input: &NoPlanInput<'_>) -> String {
    let NoPlan::NothingMeasured { candidates, asked_mm2, missed_mm2, .. } = input.finding else { return String::new() };
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
    pose: &Pose<Table, Part>,
    album: &mut Album,
    ctx: &Context<'_>,
) -> Result<String, Cancelled> {
    let subject = &input.subject;
    let Some(cell) = subject.cell else {
        let sides = three_sides(|side| pictures::plain(subject, album, *pose, side));
        return Ok(format!("<section>\n<h2>The part</h2>\n{sides}</section>\n"));
    };
    let shown: Vec<&Obstruction> = input.obstructions().iter().take(PICTURED).collect();
    if shown.is_empty() {
        let picture = pair(subject, cell, pose, &cell.home_rad, None, ctx)?;
        return Ok(format!(
            "<section>\n<h2>The part in the cell</h2>\n<p>The robot stands at home, the table at its home angle. No collision keeps \
             the robot from the viewpoints.</p>\n{picture}</section>\n"
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
        depth if depth < 0.0 => format!("{} mm deep in each other here. What helps: ", number(-depth, 1)),
        apart => format!("{} mm apart here, closer than the clearance. What helps: ", number(apart, 1)),
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
    let assembly = Assembly::at(subject, cell, pose, configuration, names);
    let model = Model::of_mesh(&assembly.mesh, ctx)?;
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
