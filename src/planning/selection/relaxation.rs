//! The linear relaxation of covering, by an interior-point method (Mehrotra 1992, *On the Implementation of a Primal-Dual
//! Interior Point Method*).
//!
//! Symbols: x_j ≥ 0 is the share of row j that is taken, s_c ≥ 0 the share of class c that stays open; A x + s ≥ 1 ties them.
//! Fewest views: min Σ x with w_gᵀ s ≤ R_g for each goal g. Most area: min wᵀ s with Σ x ≤ k. The multipliers u of the
//! classes and μ of the limits are the dual solution. They are only a start: bounds are computed from them in whole
//! numbers (`multipliers.rs`). Classes are eliminated, so that a step solves one system of the size of the rows.
//!
//! Cost: 15 to 60 steps of classes × ((rows a class)² + goals²) / 2 and rows³ / 3. The sums have a fixed order on any number of threads.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::cholesky::factored;
use super::incidence::Incidence;
use crate::geometry::SimdLevel;
use crate::planning::context::{Cancelled, Context};

/// Steps after which the best point so far is taken.
const MAX_STEPS: usize = 60;
/// Share of the way to the boundary that a step may go.
const TO_BOUNDARY: f64 = 0.995;

/// Form of the relaxation.
pub(super) enum Form {
    /// Fewest views: weights of the classes, which add up to 1, and the share that may stay open, for each goal.
    FewestViews(Vec<(Vec<f64>, f64)>),
    /// Most area: weights of the classes, which add up to 1, and the number of views.
    MostArea(Vec<f64>, f64),
}

/// Rule that ends the steps.
#[derive(Clone, Copy)]
pub(super) struct Precision {
    /// Relative gap of primal and dual value.
    pub(super) gap: f64,
    /// Share of the dual value that is relied on, for the fewest views. The steps end where the next whole number above it is
    /// that above the primal value: no bound is higher.
    pub(super) whole: Option<f64>,
}

/// A point near the optimum.
pub(super) struct Solution {
    /// x: share of each row that is taken.
    pub(super) taken: Vec<f64>,
    /// u: multiplier of each class.
    pub(super) class: Vec<f64>,
    /// μ: multiplier of each limit; 1 for `MostArea`, whose weights are taken as they are.
    pub(super) limit: Vec<f64>,
    /// Reduced cost of each row, in views: slack of its dual constraint.
    pub(super) reduced_cost: Vec<f64>,
    /// Mean complementarity product.
    pub(super) tau: f64,
    /// Value of the relaxation at the point, primal: for the fewest views, Σ x.
    pub(super) value: f64,
}

/// Solves as precisely as asked for.
///
/// # Errors
/// [`Cancelled`].
pub(super) fn solve(
    of_row: &[Vec<u32>],
    classes: usize,
    form: &Form,
    precision: Precision,
    ctx: &Context<'_>,
) -> Result<Solution, Cancelled> {
    let incidence = Incidence::new(of_row, classes);
    let model = Model::new(&incidence, form, ctx.simd_level());
    let mut point = Point::start(&model);
    for _ in 0..MAX_STEPS {
        ctx.check()?;
        if point.is_precise(&model, precision) || !point.advance(&model) {
            break;
        }
    }
    let (limit, of_view) = match form {
        Form::FewestViews(_) => (point.mu.clone(), 1.0),
        Form::MostArea(..) => (vec![1.0], point.mu[0]),
    };
    let reduced_cost = point.zx.iter().map(|cost| cost / of_view).collect();
    let tau = point.complementarity() / point.pairs() as f64;
    let value = point.scale(&model);
    Ok(Solution { taken: point.x, class: point.u, limit, reduced_cost, tau, value })
}

/// Linear program: min q·Σx + pᵀs, with A x + s − t = 1 and for each limit β·Σx + wᵀs + r = R.
struct Model<'a> {
    incidence: &'a Incidence<'a>,
    cost_of_row: f64,
    cost_of_class: Vec<f64>,
    limits: Vec<Limit>,
    level: SimdLevel,
}

struct Limit {
    beta: f64,
    weights: Vec<f64>,
    max: f64,
}

impl<'a> Model<'a> {
    fn new(incidence: &'a Incidence<'a>, form: &Form, level: SimdLevel) -> Self {
        /// A limit of nothing at all has no interior.
        const MIN_OPEN: f64 = 1e-7;
        let classes = incidence.classes();
        let (cost_of_row, cost_of_class, limits) = match form {
            Form::FewestViews(goals) => {
                let limit =
                    |(weights, open): &(Vec<f64>, f64)| Limit { beta: 0.0, weights: weights.clone(), max: open.max(MIN_OPEN) };
                (1.0, vec![0.0; classes], goals.iter().map(limit).collect())
            }
            Form::MostArea(weights, views) => {
                (0.0, weights.clone(), vec![Limit { beta: 1.0, weights: vec![0.0; classes], max: *views }])
            }
        };
        Self { incidence, cost_of_row, cost_of_class, limits, level }
    }
}

/// An interior point: primal x, s, t, r; dual u (also the slack of t), μ (also that of r), and the slacks of x and s.
struct Point {
    x: Vec<f64>,
    s: Vec<f64>,
    t: Vec<f64>,
    r: Vec<f64>,
    u: Vec<f64>,
    mu: Vec<f64>,
    zx: Vec<f64>,
    zs: Vec<f64>,
}

/// Directions of a step, by the names of [`Point`].
type Step = Point;

impl Point {
    /// A start strictly inside, primal and dual, for either form.
    fn start(model: &Model<'_>) -> Self {
        let (n, m) = (model.incidence.rows(), model.cost_of_class.len());
        let is_fewest = model.cost_of_row > 0.0;
        let min = model.limits.iter().map(|limit| limit.max).fold(f64::INFINITY, f64::min);
        let (x, s) = if is_fewest { (vec![1.0; n], vec![min / 2.0; m]) } else { (vec![min / (2.0 * n as f64); n], vec![1.0; m]) };
        let t = model.incidence.times(&x).iter().zip(&s).map(|(a, s)| a + s - 1.0).collect();
        let r = vec![min / 2.0; model.limits.len()];
        let r = if is_fewest { model.limits.iter().map(|limit| limit.max - min / 2.0).collect() } else { r };
        let weight =
            |class: usize| model.limits.iter().map(|limit| limit.weights[class]).sum::<f64>() + model.cost_of_class[class];
        let half: Vec<f64> = (0..m).map(|class| weight(class) / 2.0).collect();
        let largest = model.incidence.transposed_times(&half).into_iter().fold(0.0, f64::max);
        let (scale, mu) = if is_fewest { (1.0 / (2.0 * largest), 1.0 / (2.0 * largest)) } else { (1.0, 2.0 * largest) };
        let u: Vec<f64> = half.iter().map(|half| half * scale).collect();
        let zx = model.incidence.transposed_times(&u).iter().map(|sum| if is_fewest { 1.0 - sum } else { mu - sum }).collect();
        Self { x, s, t, r, zs: u.clone(), u, mu: vec![mu; model.limits.len()], zx }
    }

    fn pairs(&self) -> usize {
        self.x.len() + 2 * self.s.len() + self.r.len()
    }

    fn complementarity(&self) -> f64 {
        dot(&self.x, &self.zx) + dot(&self.s, &self.zs) + dot(&self.t, &self.u) + dot(&self.r, &self.mu)
    }

    /// The primal value, to which the gap is relative.
    fn scale(&self, model: &Model<'_>) -> f64 {
        model.cost_of_row * self.x.iter().sum::<f64>() + dot(&model.cost_of_class, &self.s)
    }

    /// Returns true if the steps may end: the dual value is the primal one less the complementarity.
    fn is_precise(&self, model: &Model<'_>, precision: Precision) -> bool {
        let (primal, gap) = (self.scale(model), self.complementarity());
        let is_whole = |relied_on: f64| model.cost_of_row > 0.0 && ((primal - gap) * relied_on).ceil() >= primal.ceil();
        gap <= precision.gap * primal || precision.whole.is_some_and(is_whole)
    }

    /// Takes one step; returns false when the system can no longer be solved.
    fn advance(&mut self, model: &Model<'_>) -> bool {
        let Some(system) = System::new(self, model) else { return false };
        let tau = self.complementarity() / self.pairs() as f64;
        let towards = system.direction(self, model, &Targets::of(self, None, 0.0));
        let (primal, dual) = self.lengths(&towards);
        let ahead = self.moved(&towards, primal, dual).complementarity() / self.pairs() as f64;
        let aim = tau * (ahead / tau).powi(3).clamp(1e-6, 1.0);
        let step = system.direction(self, model, &Targets::of(self, Some(&towards), aim));
        let (primal, dual) = self.lengths(&step);
        let next = self.moved(&step, primal, dual);
        let is_sound = next.complementarity().is_finite() && primal.max(dual) > 1e-8;
        if is_sound {
            *self = next;
        }
        is_sound
    }

    /// Lengths by which primal and dual can go.
    fn lengths(&self, step: &Step) -> (f64, f64) {
        let until = |values: &[f64], change: &[f64]| {
            values
                .iter()
                .zip(change)
                .filter(|(_, change)| **change < 0.0)
                .map(|(value, change)| -value / change)
                .fold(f64::INFINITY, f64::min)
        };
        let min = |pairs: [(&Vec<f64>, &Vec<f64>); 4]| {
            pairs.iter().map(|(value, change)| until(value, change)).fold(f64::INFINITY, f64::min)
        };
        let primal = min([(&self.x, &step.x), (&self.s, &step.s), (&self.t, &step.t), (&self.r, &step.r)]);
        let dual = min([(&self.u, &step.u), (&self.mu, &step.mu), (&self.zx, &step.zx), (&self.zs, &step.zs)]);
        ((TO_BOUNDARY * primal).min(1.0), (TO_BOUNDARY * dual).min(1.0))
    }

    fn moved(&self, step: &Step, primal: f64, dual: f64) -> Self {
        let add = |values: &[f64], change: &[f64], length: f64| -> Vec<f64> {
            values.iter().zip(change).map(|(value, change)| value + length * change).collect()
        };
        Self {
            x: add(&self.x, &step.x, primal),
            s: add(&self.s, &step.s, primal),
            t: add(&self.t, &step.t, primal),
            r: add(&self.r, &step.r, primal),
            u: add(&self.u, &step.u, dual),
            mu: add(&self.mu, &step.mu, dual),
            zx: add(&self.zx, &step.zx, dual),
            zs: add(&self.zs, &step.zs, dual),
        }
    }
}

/// Changes asked of each complementarity product.
struct Targets {
    x: Vec<f64>,
    s: Vec<f64>,
    t: Vec<f64>,
    r: Vec<f64>,
}

impl Targets {
    /// Targets towards `aim`, less the second-order term of the step before.
    fn of(point: &Point, before: Option<&Step>, aim: f64) -> Self {
        let target = |a: &[f64], b: &[f64], change: Option<(&[f64], &[f64])>| -> Vec<f64> {
            let second = |i: usize| change.map_or(0.0, |(da, db)| da[i] * db[i]);
            (0..a.len()).map(|i| aim - a[i] * b[i] - second(i)).collect()
        };
        Self {
            x: target(&point.x, &point.zx, before.map(|step| (&step.x[..], &step.zx[..]))),
            s: target(&point.s, &point.zs, before.map(|step| (&step.s[..], &step.zs[..]))),
            t: target(&point.t, &point.u, before.map(|step| (&step.t[..], &step.u[..]))),
            r: target(&point.r, &point.mu, before.map(|step| (&step.r[..], &step.mu[..]))),
        }
    }
}

/// The reduced system at a point: M dx + B dμ = f, Bᵀ dx − E dμ = g.
struct System {
    /// Residuals of classes and rows: rounding alone, since every point is feasible; they are driven back to 0.
    open: Vec<f64>,
    of_rows: Vec<f64>,
    /// D = 1 / (s/z_s + t/u).
    d: Vec<f64>,
    theta_s: Vec<f64>,
    m: Cholesky<f64, Dyn>,
    b: Vec<DVector<f64>>,
    /// M⁻¹ B.
    solved_b: Vec<DVector<f64>>,
    /// E + Bᵀ M⁻¹ B, factored by its lower triangle.
    schur: Cholesky<f64, Dyn>,
}

impl System {
    fn new(point: &Point, model: &Model<'_>) -> Option<Self> {
        let theta_s: Vec<f64> = point.s.iter().zip(&point.zs).map(|(s, z)| s / z).collect();
        let theta_t: Vec<f64> = point.t.iter().zip(&point.u).map(|(t, u)| t / u).collect();
        let d: Vec<f64> = theta_s.iter().zip(&theta_t).map(|(s, t)| 1.0 / (s + t)).collect();
        let mut m = model.incidence.weighted_square(&d, model.level);
        (0..point.x.len()).for_each(|j| m[(j, j)] += point.zx[j] / point.x[j]);
        let m = factored(m, model.level)?;
        let b: Vec<DVector<f64>> = model
            .limits
            .iter()
            .map(|limit| {
                let weighted: Vec<f64> = (0..d.len()).map(|c| d[c] * theta_s[c] * limit.weights[c]).collect();
                DVector::from_vec(model.incidence.transposed_times(&weighted)).map(|sum| limit.beta - sum)
            })
            .collect();
        let solved_b: Vec<DVector<f64>> = b.iter().map(|b| m.solve(b)).collect();
        let schur = DMatrix::from_fn(b.len(), b.len(), |g, h| {
            if g < h {
                return 0.0;
            }
            let (of_g, of_h) = (&model.limits[g].weights, &model.limits[h].weights);
            let shared: f64 = (0..d.len()).map(|c| of_g[c] * of_h[c] * theta_s[c] * theta_t[c] * d[c]).sum();
            b[g].dot(&solved_b[h]) + shared + if g == h { point.r[g] / point.mu[g] } else { 0.0 }
        });
        let (ax, atu) = (model.incidence.times(&point.x), model.incidence.transposed_times(&point.u));
        let beta_mu: f64 = model.limits.iter().zip(&point.mu).map(|(limit, mu)| limit.beta * mu).sum();
        let open: Vec<f64> = (0..d.len()).map(|c| 1.0 - (ax[c] + point.s[c] - point.t[c])).collect();
        let of_rows = (0..point.x.len()).map(|j| model.cost_of_row - atu[j] + beta_mu - point.zx[j]).collect();
        Some(Self { open, of_rows, d, theta_s, m, b, solved_b, schur: Cholesky::new(schur)? })
    }

    /// The step that changes the products as asked, on the equations as they stand.
    fn direction(&self, point: &Point, model: &Model<'_>, targets: &Targets) -> Step {
        let (m, n) = (self.d.len(), point.x.len());
        let weighted =
            |mu: &[f64], class: usize| model.limits.iter().zip(mu).map(|(limit, mu)| limit.weights[class] * mu).sum::<f64>();
        let of_classes: Vec<f64> = (0..m)
            .map(|c| model.cost_of_class[c] - point.u[c] + weighted(&point.mu, c) - point.zs[c] - targets.s[c] / point.s[c])
            .collect();
        let h: Vec<f64> =
            (0..m).map(|c| self.d[c] * (self.open[c] + self.theta_s[c] * of_classes[c] + targets.t[c] / point.u[c])).collect();
        let ath = model.incidence.transposed_times(&h);
        let f = DVector::from_fn(n, |j, _| ath[j] - self.of_rows[j] + targets.x[j] / point.x[j]);
        let sum_x: f64 = point.x.iter().sum();
        let g = model.limits.iter().enumerate().map(|(g, limit)| {
            let left = limit.max - limit.beta * sum_x - dot(&limit.weights, &point.s) - point.r[g];
            let classes: f64 = (0..m).map(|c| limit.weights[c] * self.theta_s[c] * (h[c] - of_classes[c])).sum();
            left - targets.r[g] / point.mu[g] - classes
        });
        let solved_f = self.m.solve(&f);
        let right = DVector::from_iterator(self.b.len(), self.b.iter().zip(g).map(|(b, g)| b.dot(&solved_f) - g));
        let mu: Vec<f64> = self.schur.solve(&right).iter().copied().collect();
        let x = self.solved_b.iter().zip(&mu).fold(solved_f, |x, (b, mu)| x - b * *mu);
        let x: Vec<f64> = x.iter().copied().collect();
        let ax = model.incidence.times(&x);
        let u: Vec<f64> = (0..m).map(|c| h[c] + self.d[c] * (self.theta_s[c] * weighted(&mu, c) - ax[c])).collect();
        let s = (0..m).map(|c| self.theta_s[c] * (u[c] - weighted(&mu, c) - of_classes[c])).collect::<Vec<f64>>();
        Step {
            zx: (0..n).map(|j| (targets.x[j] - point.zx[j] * x[j]) / point.x[j]).collect(),
            zs: (0..m).map(|c| (targets.s[c] - point.zs[c] * s[c]) / point.s[c]).collect(),
            t: (0..m).map(|c| (targets.t[c] - point.t[c] * u[c]) / point.u[c]).collect(),
            r: (0..mu.len()).map(|g| (targets.r[g] - point.r[g] * mu[g]) / point.mu[g]).collect(),
            x,
            s,
            u,
            mu,
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
