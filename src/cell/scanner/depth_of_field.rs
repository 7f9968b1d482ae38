//! Depth of field of a focused lens, after Wang, *Quality-Based Path Planning*, section 3.1.1.2, whose two signs are
//! swapped in print: the field behind the focus is the larger one.
//!
//! Symbols: f focal length, Fe effective f-number, δ largest tolerated circle of confusion, x distance in focus, all
//! in mm. With b = δ·Fe: front = b x² / (f² + b x), rear = b x² / (f² − b x), infinite from x = f²/b on. Thin lens,
//! x much larger than f.

/// Range of sharpness on both sides of the distance in focus.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthOfField {
    /// Range towards the camera, mm.
    pub front_mm: f64,
    /// Away from it, mm; infinite from the hyperfocal distance on.
    pub rear_mm: f64,
}

impl DepthOfField {
    /// Depth of field at `focus_mm` of a lens of focal length `focal_mm` when `blur_mm` = δ·Fe is tolerated.
    #[must_use]
    pub fn at(focus_mm: f64, focal_mm: f64, blur_mm: f64) -> Self {
        let (f2, bx) = (focal_mm * focal_mm, blur_mm * focus_mm);
        let rear_mm = if bx < f2 { bx * focus_mm / (f2 - bx) } else { f64::INFINITY };
        Self { front_mm: bx * focus_mm / (f2 + bx), rear_mm }
    }

    /// The δ·Fe that explains a measured depth of field, from its front and from its rear side; they agree when the
    /// depth is that of a lens.
    #[must_use]
    pub fn blur_mm(&self, focus_mm: f64, focal_mm: f64) -> [f64; 2] {
        let f2 = focal_mm * focal_mm;
        let front = self.front_mm * f2 / (focus_mm * (focus_mm - self.front_mm));
        let rear =
            if self.rear_mm.is_finite() { self.rear_mm * f2 / (focus_mm * (focus_mm + self.rear_mm)) } else { f2 / focus_mm };
        [front, rear]
    }
}

/// Focus distance from which everything behind is sharp: f²/(δ·Fe), mm.
#[must_use]
pub fn hyperfocal_distance_mm(focal_mm: f64, blur_mm: f64) -> f64 {
    focal_mm * focal_mm / blur_mm
}
