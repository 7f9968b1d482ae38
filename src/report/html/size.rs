//! Notices on a part whose size tells of a wrong unit, and on a plan with warnings.

use super::markup::{escape, grouped, prose};
use crate::wire::warnings::{FieldWarning, parameter_of};

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

/// A notice for each warning on a plan; nothing where there are none.
pub(super) fn notices_of_plan(warnings: &[FieldWarning]) -> String {
    let notice = |warning: &FieldWarning| {
        format!(
            "<div class=\"notice\" style=\"margin-bottom:12px\"><p><b>Warning</b> (<code>{}</code>), <code>{}</code>: {}. \
             What to do: {}.</p></div>\n",
            warning.code.as_str(),
            escape(&parameter_of(warning)),
            escape(&grouped(&warning.detail)),
            prose(&grouped(&warning.remedy))
        )
    };
    warnings.iter().map(notice).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::warnings::WarningCode;

    #[test]
    fn a_part_that_would_tip_over_has_a_notice() {
        let warning = FieldWarning {
            code: WarningCode::PartUnstable,
            pointer: "/params/part/table_from_part".to_owned(),
            detail: "the part would tip over as it is placed".to_owned(),
            remedy: "turn it".to_owned(),
        };
        let notice = notices_of_plan(&[warning]);
        let told = "(<code>part_unstable</code>), <code>part.table_from_part</code>: the part would tip over as it is placed. What to do: \
                    turn it.</p>";
        assert!(notice.contains(told), "{notice}");
        assert_eq!(notices_of_plan(&[]), "");
    }
}
