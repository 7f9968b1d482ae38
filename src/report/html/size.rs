//! Notices on a part whose size tells of a wrong unit.

use super::markup::{escape, grouped, prose};
use crate::wire::warnings::FieldWarning;

/// A notice for each warning on the part's size; nothing where there are none.
pub(super) fn notices(warnings: &[FieldWarning]) -> String {
    let notice = |warning: &FieldWarning| {
        format!(
            "<div class=\"notice\" style=\"margin-bottom:12px\"><p><b>Check the unit of the part</b> (<code>{}</code>): it {}. \
             What to do: {}.</p></div>\n",
            warning.code.as_str(),
            escape(&grouped(&warning.detail)),
            prose(&grouped(&warning.remedy))
        )
    };
    warnings.iter().map(notice).collect()
}
