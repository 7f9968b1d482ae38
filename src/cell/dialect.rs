//! Languages of robot controllers, by the names that specifications, requests and files have. The programs themselves are made
//! in [`crate::program::dialects`].

use super::closed_list::closed_list;
use super::closest::did_you_mean;

closed_list! {
    /// A language of robot controllers.
    pub enum Dialect {
        /// Commands of Han's CPS interface, one a line.
        Hans = "hans",
        /// Universal Robots URScript.
        Urscript = "urscript",
        /// ABB RAPID.
        Rapid = "rapid",
        /// KUKA KRL, two files.
        Krl = "krl",
        /// FANUC TP, ASCII.
        Fanuc = "fanuc",
        /// Python for RoboDK, which drives robots of any maker.
        Robodk = "robodk",
        /// A table of joints and poses, of no maker.
        Csv = "csv",
    }
}

impl Dialect {
    /// Returns true if it belongs to no maker of robots: it suits them all.
    #[must_use]
    pub fn is_neutral(self) -> bool {
        matches!(self, Self::Robodk | Self::Csv)
    }
}

impl std::str::FromStr for Dialect {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        Self::ALL.into_iter().find(|dialect| dialect.as_str() == name).ok_or_else(|| {
            let known = Self::ALL.map(Self::as_str);
            format!("unknown dialect {name:?}; known are {}{}", known.join(", "), did_you_mean(name, known))
        })
    }
}
