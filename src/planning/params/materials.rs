//! Materials of the surface: what the projector's light makes of it ([`crate::cell::Exposure`]).

use super::knob::params;
use super::regions::Region;
use crate::cell::{Findings, Finish, Material};

params! {
    /// Materials of the surface. If several regions contain a sample, the last one applies.
    MaterialParams {
        /// Finish of the part outside the regions. Default: `matte_white`, where exposure is predicted.
        finish: Option<Finish> = None;
        /// Albedo outside the regions: the share of the incident light that the surface scatters. Default: that of the finish.
        albedo: Option<f64> = None, [0.001, 1.0] "";
        /// Brightness inside the specular cone, relative to a white surface, outside the regions. Default: that of the finish.
        gloss: Option<f64> = None, [0.0, 10_000.0] "";
        /// Half-angle of the specular cone outside the regions, degrees. A larger angle spreads glare over more views. Default:
        /// that of the finish.
        lobe_deg: Option<f64> = None, [0.0, 90.0] "°";
        /// Regions of another material.
        regions: Vec<RegionMaterialParams> = Vec::new(), entries [0, 100];
    }
}

params! {
    /// Material of a region.
    required RegionMaterialParams {
        /// Region of the surface.
        region: Region;
        /// Finish of the region. Default: that of the part.
        #[serde(default)]
        finish: Option<Finish>;
        /// Albedo: the share of the incident light that the surface scatters. Default: that of the finish.
        #[serde(default)]
        albedo: Option<f64>, [0.001, 1.0] "";
        /// Brightness inside the specular cone, relative to a white surface. Default: that of the finish.
        #[serde(default)]
        gloss: Option<f64>, [0.0, 10_000.0] "";
        /// Half-angle of the specular cone, degrees. Default: that of the finish.
        #[serde(default)]
        lobe_deg: Option<f64>, [0.0, 90.0] "°";
    }
}

/// A material with what is said of it otherwise: albedo, gloss, lobe in degrees.
fn with(material: Material, [albedo, gloss, lobe_deg]: [Option<f64>; 3]) -> Material {
    Material {
        albedo: albedo.unwrap_or(material.albedo),
        gloss: gloss.unwrap_or(material.gloss),
        lobe_rad: lobe_deg.map_or(material.lobe_rad, f64::to_radians),
    }
}

impl MaterialParams {
    /// Returns true if nothing is said.
    #[must_use]
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// Material outside all regions.
    #[must_use]
    pub fn of_part(&self) -> Material {
        with(self.finish.unwrap_or(Finish::MatteWhite).material(), [self.albedo, self.gloss, self.lobe_deg])
    }

    /// Material of a region.
    #[must_use]
    pub fn of_region(&self, region: &RegionMaterialParams) -> Material {
        let finish = region.finish.map_or_else(|| self.of_part(), Finish::material);
        with(finish, [region.albedo, region.gloss, region.lobe_deg])
    }

    pub(super) fn check(&self, findings: &mut Findings) {
        self.check_ranges("/materials", findings);
        for (index, region) in self.regions.iter().enumerate() {
            let at = format!("/materials/regions/{index}");
            region.region.check(&format!("{at}/region"), findings);
            region.check_ranges(&at, findings);
        }
    }
}
