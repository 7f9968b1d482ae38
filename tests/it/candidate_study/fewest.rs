//! Few views for a given area, near enough to the fewest to compare sets of candidates by: greedy, then for one view fewer
//! the view that loses least is exchanged for the one that gains most, tabu for a while.

use std::collections::HashMap;

use vantage::planning::visibility::Row;

/// Exchanges without reaching the area before a number of views is given up.
const EXCHANGES: usize = 300;
/// Samples that stand for the surface, every so many of its own: a share is then known to half a point.
const SAMPLES: usize = 10_000;

/// Samples that the same candidates measure, as one.
pub(super) struct Instance {
    area_mm2: Vec<f64>,
    /// Of each candidate the classes it measures.
    classes_of: Vec<Vec<u32>>,
}

impl Instance {
    pub(super) fn new(rows: &[Row], asked_area_mm2: &[f64]) -> Self {
        let mut measured_by: Vec<Vec<u16>> = vec![Vec::new(); asked_area_mm2.len()];
        for (number, row) in rows.iter().enumerate() {
            row.samples().for_each(|sample| measured_by[sample as usize].push(number as u16));
        }
        let mut class_of: HashMap<Vec<u16>, usize> = HashMap::new();
        let (mut area_mm2, mut classes_of) = (Vec::new(), vec![Vec::new(); rows.len()]);
        let every = asked_area_mm2.len().div_ceil(SAMPLES);
        for (candidates, sample_mm2) in measured_by.into_iter().zip(asked_area_mm2).step_by(every) {
            if candidates.is_empty() || *sample_mm2 == 0.0 {
                continue;
            }
            let class = *class_of.entry(candidates).or_insert_with_key(|candidates| {
                candidates.iter().for_each(|candidate| classes_of[usize::from(*candidate)].push(area_mm2.len() as u32));
                area_mm2.push(0.0);
                area_mm2.len() - 1
            });
            area_mm2[class] += sample_mm2;
        }
        Self { area_mm2, classes_of }
    }

    /// Area that some candidate measures, of the samples that stand for the surface.
    pub(super) fn coverable_mm2(&self) -> f64 {
        self.area_mm2.iter().sum()
    }

    /// Few candidates that measure `target_mm2` together, if all of them do.
    pub(super) fn fewest(&self, target_mm2: f64) -> Option<Vec<usize>> {
        let mut best = self.greedy(target_mm2)?;
        while let Some(fewer) = self.exchanged(&best, target_mm2) {
            best = fewer;
        }
        Some(best)
    }

    fn greedy(&self, target_mm2: f64) -> Option<Vec<usize>> {
        let mut cover = Cover::new(self);
        while cover.covered_mm2 < target_mm2 {
            let next = cover.best_to_add(|_| true)?;
            if cover.gain_mm2(next) <= 0.0 {
                return None;
            }
            cover.add(next);
        }
        Some(cover.chosen)
    }

    /// One view fewer than `views`, if some are found that measure as much.
    fn exchanged(&self, views: &[usize], target_mm2: f64) -> Option<Vec<usize>> {
        let mut cover = Cover::new(self);
        views.iter().for_each(|view| cover.add(*view));
        let least = cover.least_to_lose(|_| true)?;
        cover.remove(least);
        let mut tabu_until = vec![0; self.classes_of.len()];
        for exchange in 1..=EXCHANGES {
            if cover.covered_mm2 >= target_mm2 {
                return Some(cover.chosen);
            }
            let out = cover.least_to_lose(|view| tabu_until[view] < exchange)?;
            cover.remove(out);
            // Tenures of different length, so that the search does not run in a circle.
            tabu_until[out] = exchange + 3 + exchange % 5;
            let next = cover.best_to_add(|view| tabu_until[view] < exchange)?;
            cover.add(next);
            tabu_until[next] = exchange + 1 + exchange % 3;
        }
        None
    }
}

/// Chosen candidates, and how many of them measure each class.
struct Cover<'a> {
    instance: &'a Instance,
    chosen: Vec<usize>,
    times: Vec<u32>,
    covered_mm2: f64,
}

impl<'a> Cover<'a> {
    fn new(instance: &'a Instance) -> Self {
        Self { instance, chosen: Vec::new(), times: vec![0; instance.area_mm2.len()], covered_mm2: 0.0 }
    }

    /// Area of the classes of a view that are measured `times`.
    fn area_mm2(&self, view: usize, times: u32) -> f64 {
        let classes = self.instance.classes_of[view].iter().map(|class| *class as usize);
        classes.filter(|class| self.times[*class] == times).map(|class| self.instance.area_mm2[class]).sum()
    }

    fn gain_mm2(&self, view: usize) -> f64 {
        self.area_mm2(view, 0)
    }

    fn best_to_add(&self, may: impl Fn(usize) -> bool) -> Option<usize> {
        let others = (0..self.candidates()).filter(|view| may(*view) && !self.chosen.contains(view));
        others.map(|view| (self.gain_mm2(view), view)).reduce(|a, b| if b.0 > a.0 { b } else { a }).map(|(_, view)| view)
    }

    fn least_to_lose(&self, may: impl Fn(usize) -> bool) -> Option<usize> {
        let chosen = self.chosen.iter().copied().filter(|view| may(*view));
        chosen.map(|view| (self.area_mm2(view, 1), view)).reduce(|a, b| if b.0 < a.0 { b } else { a }).map(|(_, view)| view)
    }

    fn candidates(&self) -> usize {
        self.instance.classes_of.len()
    }

    fn add(&mut self, view: usize) {
        self.covered_mm2 += self.gain_mm2(view);
        self.instance.classes_of[view].iter().for_each(|class| self.times[*class as usize] += 1);
        self.chosen.push(view);
    }

    fn remove(&mut self, view: usize) {
        self.covered_mm2 -= self.area_mm2(view, 1);
        self.instance.classes_of[view].iter().for_each(|class| self.times[*class as usize] -= 1);
        self.chosen.retain(|chosen| *chosen != view);
    }
}
