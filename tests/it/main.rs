//! The integration tests: one binary, one module a topic.

#![expect(clippy::float_cmp, reason = "tests hold to the bit what is exact")]

mod advice;
mod architecture;
mod arms;
mod bounds;
mod candidate_listing;
mod candidate_rounds;
mod candidate_study;
mod cell_sight;
mod certified_figures;
mod closed_form;
mod command_line;
mod device_limits;
mod dialects;
mod goldens;
mod http;
mod inspect_scanner;
mod kinematics;
mod meshes;
mod miss_report;
mod oracle_client;
mod oracle_collision;
mod oracle_controllers;
mod oracle_coverage;
mod oracle_dialects;
mod oracle_selection;
mod oracle_time_law;
mod own_hardware;
mod packet_rays;
mod plan_command;
mod planning_with_cell;
mod public_figures;
mod raster_engine;
mod reach_study;
mod readme;
mod realism;
mod regions;
mod report;
mod robust;
mod server;
mod setups;
mod standoff_study;
mod study_command;
mod support;
mod wrong_inputs;
