//! Microseconds that every solution of the inverse takes, for poses all over the workspace: a closed form of each kind, an
//! arm that is solved by steps, and the crate `rs-opw-kinematics` on the same arm and joint vectors. `cargo bench --bench
//! kinematics`; criterion's time is of [`POSES`] poses.

use criterion::{Criterion, criterion_group, criterion_main};
use rs_opw_kinematics::kinematic_traits::Kinematics as _;
use rs_opw_kinematics::kinematics_impl::OPWKinematics;
use rs_opw_kinematics::parameters::opw_kinematics::Parameters;
use std::hint::black_box;
use vantage::cell::{Presets, Robot, SpecLibrary};

/// Poses of a round.
const POSES: u32 = 1000;

fn preset(name: &str) -> Robot {
    Presets.robot(name).expect("a preset").build().expect("a sound preset")
}

/// Evenly spread joint vectors within the limits.
fn spread(robot: &Robot) -> Vec<[f64; 6]> {
    let steps = [2.0_f64, 3.0, 5.0, 7.0, 11.0, 13.0].map(f64::sqrt);
    let at = |i: u32, joint: usize| {
        let axis = robot.joints[joint];
        axis.min_rad + (axis.max_rad - axis.min_rad) * (f64::from(i) * steps[joint]).fract()
    };
    (1..=POSES).map(|i| std::array::from_fn(|joint| at(i, joint))).collect()
}

fn inverse(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("inverse of 1000 poses");
    for name in ["abb-irb2400-10", "hans-e05", "ur5e"] {
        let robot = preset(name);
        let poses: Vec<_> = spread(&robot).iter().map(|joints| robot.base_from_flange(joints)).collect();
        group.bench_function(name, |bencher| {
            bencher.iter(|| poses.iter().map(|pose| black_box(robot.kinematics.ik_solutions(pose)).len()).sum::<usize>());
        });
    }
    let peer = OPWKinematics::new(Parameters::irb2400_10());
    let poses: Vec<_> = spread(&preset("abb-irb2400-10")).iter().map(|joints| peer.forward(joints)).collect();
    group.bench_function("rs-opw-kinematics, abb-irb2400-10", |bencher| {
        bencher.iter(|| poses.iter().map(|pose| black_box(peer.inverse(pose)).len()).sum::<usize>());
    });
    group.finish();
}

criterion_group!(benches, inverse);
criterion_main!(benches);
