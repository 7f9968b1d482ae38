//! Viewpoints to the table of what each measures.

/// What one view measures.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Row {
    /// Samples measured, ascending.
    pub samples: Vec<u32>,
    /// c·Q_δ + d·Q_dis at each of them.
    pub quality: Vec<f32>,
}
