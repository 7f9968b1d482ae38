//! A client of a Han's controller that is not of this project, libhans: moves the arm there and back, stops it on its way, and
//! prints what it reads, one line each: `NAME VALUE…`, angles in degrees.

use std::thread::sleep;
use std::time::{Duration, Instant};

use libhans::{CommandSerde, HansS30, RobotMode};

/// Longest motion.
const PATIENCE: Duration = Duration::from_secs(60);

/// Joints as the controller reports them. The maker's SDK has the pose first and the joints behind it; libhans names the first six
/// values of the reply `joint` and the next `pose_o_to_ee`.
fn joints(robot: &mut HansS30, name: &str) -> [f64; 6] {
    let joints = robot.robot_impl.state_read_act_pos(0).expect("a position").pose_o_to_ee;
    println!("{name} {}", joints.map(|joint| format!("{joint}")).join(" "));
    joints
}

fn stand_by(robot: &mut HansS30) {
    let until = Instant::now() + PATIENCE;
    while robot.robot_impl.state_read_cur_fsm(0).expect("a state") != RobotMode::StandBy {
        assert!(Instant::now() < until, "it does not come to rest");
        sleep(Duration::from_millis(20));
    }
}

fn way_point(robot: &mut HansS30, joints_deg: &[f64; 6], number: u32) {
    let target = joints_deg.map(|joint| format!("{joint}")).join(",");
    let text = format!("0,0,0,0,0,0,{target},TCP,Base,180,720,0,0,1,0,0,0,{number}");
    let point = CommandSerde::from_str(&text).expect("a way point");
    robot.robot_impl.move_way_point((0, point)).expect("accepted");
}

fn path(robot: &mut HansS30, from_deg: &[f64; 6], to_deg: &[f64; 6]) {
    const POINTS: u32 = 6;
    let settings = CommandSerde::from_str("there,0.5,2").expect("settings of a path");
    robot.robot_impl.start_push_move_path_j((0, settings)).expect("accepted");
    for point in 0..POINTS {
        let share = f64::from(point) / f64::from(POINTS - 1);
        let joints = std::array::from_fn(|joint| from_deg[joint] + share * (to_deg[joint] - from_deg[joint]));
        robot.robot_impl.push_move_path_j((0, "there".to_owned(), joints)).expect("accepted");
    }
    robot.robot_impl.end_push_move_path((0, "there".to_owned())).expect("accepted");
    let until = Instant::now() + PATIENCE;
    while robot.robot_impl.read_move_path_state((0, "there".to_owned())).expect("a state") != 3 {
        assert!(Instant::now() < until, "the path is not computed");
        sleep(Duration::from_millis(20));
    }
    robot.robot_impl.move_path_j((0, "there".to_owned())).expect("accepted");
}

fn main() {
    let host = std::env::args().nth(1).expect("the address of the controller, without its port");
    // Connects to port 10003, and sets the override to 0.1.
    let mut robot = HansS30::new(&host);
    robot.set_scale(1.0).expect("an override");
    stand_by(&mut robot);
    let home = joints(&mut robot, "home");
    let away = [home[0] + 20.0, home[1] - 10.0, home[2] + 5.0, home[3] + 15.0, home[4] - 10.0, home[5] + 30.0];
    way_point(&mut robot, &away, 1);
    sleep(Duration::from_millis(100));
    println!("moving {}", robot.robot_impl.state_read_cur_fsm(0).expect("a state") == RobotMode::Moving);
    stand_by(&mut robot);
    let there = joints(&mut robot, "way_point");
    path(&mut robot, &there, &home);
    sleep(Duration::from_millis(100));
    stand_by(&mut robot);
    joints(&mut robot, "path");
    way_point(&mut robot, &away, 2);
    sleep(Duration::from_millis(200));
    robot.robot_impl.robot_move_stop(0).expect("accepted");
    stand_by(&mut robot);
    let stopped = joints(&mut robot, "stopped");
    sleep(Duration::from_millis(300));
    let later = joints(&mut robot, "later");
    println!("still {}", stopped == later);
    robot.disconnect();
}
