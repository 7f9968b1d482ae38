//! Requests, typed: written by drivers, read by the simulator.

use super::{HansSyntax, fields, message, number, real, reals};

/// Declares the commands without arguments, with their names and with what stands before the arguments of the others: the
/// number of the robot, or nothing.
macro_rules! commands {
    ($($(#[$meta:meta])* $variant:ident = $name:literal, $has_robot:literal;)*) => {
        /// A command without arguments.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum HansCommand {$(
            $(#[$meta])*
            $variant,
        )*}

        impl HansCommand {
            /// Every command.
            pub const ALL: &'static [Self] = &[$(Self::$variant),*];

            /// Name on the wire.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)*
                }
            }

            /// Returns true if the number of the robot follows the name.
            fn has_robot(self) -> bool {
                match self {
                    $(Self::$variant => $has_robot,)*
                }
            }
        }
    };
}

commands! {
    /// Connects the control box.
    ConnectToBox = "ConnectToBox", false;
    /// Switches the robot's 48 V on.
    Electrify = "Electrify", false;
    /// Switches the robot's 48 V off.
    BlackOut = "BlackOut", false;
    /// Starts the fieldbus master.
    StartMaster = "StartMaster", false;
    /// Ends the fieldbus master.
    CloseMaster = "CloseMaster", false;
    /// Asks whether the robot is simulated.
    IsSimulation = "IsSimulation", false;
    /// Asks whether the controller has started.
    ReadControllerState = "ReadControllerState", false;
    /// Reads versions.
    ReadVersion = "ReadVersion", true;
    /// Reads the model.
    ReadRobotModel = "ReadRobotModel", true;
    /// Enables the drives.
    GrpPowerOn = "GrpPowerOn", true;
    /// Disables the drives.
    GrpPowerOff = "GrpPowerOff", true;
    /// Clears errors.
    GrpReset = "GrpReset", true;
    /// Stops the motion.
    GrpStop = "GrpStop", true;
    /// Pauses the motion.
    GrpInterrupt = "GrpInterrupt", true;
    /// Goes on with the motion.
    GrpContinue = "GrpContinue", true;
    /// Begins guiding by hand.
    GrpOpenFreeDriver = "GrpOpenFreeDriver", true;
    /// Ends guiding by hand.
    GrpCloseFreeDriver = "GrpCloseFreeDriver", true;
    /// Reads measured pose and joints.
    ReadActPos = "ReadActPos", true;
    /// Reads thirteen flags.
    ReadRobotState = "ReadRobotState", true;
    /// Reads emergency stop and guard.
    ReadEmergencyInfo = "ReadEmergencyInfo", true;
    /// Reads the number of the controller's state.
    ReadCurFsm = "ReadCurFSM", true;
    /// Reads the name of the way point under way.
    ReadCurWayPointId = "ReadCurWayPointID", true;
}

/// A way point: where to, how fast, and under what name.
#[derive(Clone, Debug, PartialEq)]
pub struct HansWayPoint {
    /// Pose of the tool, mm and degrees; of no effect where the joints are the target.
    pub pose: [f64; 6],
    /// Joints, degrees.
    pub joints_deg: [f64; 6],
    /// Tool frame.
    pub tool: String,
    /// User frame.
    pub user_frame: String,
    /// Speed, °/s or mm/s.
    pub speed: f64,
    /// Acceleration, °/s² or mm/s².
    pub acceleration: f64,
    /// Radius of the blend to the next way point, mm; 0 stops.
    pub radius_mm: f64,
    /// True for a straight line of the tool, false for one of the joints.
    pub is_linear: bool,
    /// True if the joints are the target, and not only the branch.
    pub is_joint_target: bool,
    /// Name, which the controller repeats.
    pub command_id: String,
}

/// Request to a Han's controller.
#[derive(Clone, Debug, PartialEq)]
pub enum HansRequest {
    /// A command without arguments.
    Plain(HansCommand),
    /// Share of the speed, 0 to 1.
    SetOverride {
        /// The share.
        fraction: f64,
    },
    /// A move.
    WayPoint(Box<HansWayPoint>),
    /// Begins a path.
    StartPushMovePath {
        /// Name of the path.
        name: String,
        /// Share of the speed.
        speed_fraction: f64,
        /// Radius of blends, mm.
        radius_mm: f64,
    },
    /// Adds a point to a path.
    PushMovePathJ {
        /// Name of the path.
        name: String,
        /// Joints, degrees.
        joints_deg: [f64; 6],
    },
    /// Ends a path.
    EndPushMovePath {
        /// Name of the path.
        name: String,
    },
    /// Asks how far the controller is with a path: 3 computed, 5 error.
    ReadMovePathState {
        /// Name of the path.
        name: String,
    },
    /// Moves along a path.
    MovePath {
        /// Name of the path.
        name: String,
    },
    /// Begins servo streaming.
    StartServo {
        /// Period in seconds or gain, by the firmware.
        argument: f64,
        /// Look-ahead, s.
        lookahead_secs: f64,
    },
    /// Sets the joints of servo streaming.
    PushServoJ {
        /// Joints, degrees.
        joints_deg: [f64; 6],
    },
    /// Sets a digital output of the control box.
    SetBoxDo {
        /// Number of the output.
        output: u8,
        /// Level.
        is_on: bool,
    },
    /// Reads a digital input of the control box.
    ReadBoxDi {
        /// Number of the input.
        input: u8,
    },
    /// Asks where the tool is at these joints.
    Acs2Pcs {
        /// Joints, degrees.
        joints_deg: [f64; 6],
        /// Tool in the flange frame, mm and degrees.
        tool: [f64; 6],
        /// User frame in the base, mm and degrees.
        user_frame: [f64; 6],
    },
}

impl HansRequest {
    /// Name on the wire, which the reply repeats.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Plain(command) => command.name(),
            Self::SetOverride { .. } => "SetOverride",
            Self::WayPoint(_) => "WayPoint",
            Self::StartPushMovePath { .. } => "StartPushMovePath",
            Self::PushMovePathJ { .. } => "PushMovePathJ",
            Self::EndPushMovePath { .. } => "EndPushMovePath",
            Self::ReadMovePathState { .. } => "ReadMovePathState",
            Self::MovePath { .. } => "MovePath",
            Self::StartServo { .. } => "StartServo",
            Self::PushServoJ { .. } => "PushServoJ",
            Self::SetBoxDo { .. } => "SetBoxDO",
            Self::ReadBoxDi { .. } => "ReadBoxDI",
            Self::Acs2Pcs { .. } => "ACS2PCS",
        }
    }

    /// Message on the wire.
    #[must_use]
    pub fn encode(&self) -> String {
        let robot = match self {
            Self::Plain(command) if !command.has_robot() => None,
            Self::SetBoxDo { .. } | Self::ReadBoxDi { .. } => None,
            Self::Plain(_)
            | Self::SetOverride { .. }
            | Self::WayPoint(_)
            | Self::StartPushMovePath { .. }
            | Self::PushMovePathJ { .. }
            | Self::EndPushMovePath { .. }
            | Self::ReadMovePathState { .. }
            | Self::MovePath { .. }
            | Self::StartServo { .. }
            | Self::PushServoJ { .. }
            | Self::Acs2Pcs { .. } => Some("0".to_owned()),
        };
        message(self.name(), robot.into_iter().chain(self.arguments()))
    }

    fn arguments(&self) -> Vec<String> {
        let numbers = |values: &[f64]| values.iter().map(|value| number(*value)).collect::<Vec<_>>();
        match self {
            Self::Plain(_) => Vec::new(),
            Self::SetOverride { fraction } => numbers(&[*fraction]),
            Self::WayPoint(point) => point.arguments(),
            Self::StartPushMovePath { name, speed_fraction, radius_mm } => {
                [vec![name.clone()], numbers(&[*speed_fraction, *radius_mm])].concat()
            }
            Self::PushMovePathJ { name, joints_deg } => [vec![name.clone()], numbers(joints_deg)].concat(),
            Self::EndPushMovePath { name } | Self::ReadMovePathState { name } | Self::MovePath { name } => vec![name.clone()],
            Self::StartServo { argument, lookahead_secs } => numbers(&[*argument, *lookahead_secs]),
            Self::PushServoJ { joints_deg } => numbers(joints_deg),
            Self::SetBoxDo { output, is_on } => vec![output.to_string(), u8::from(*is_on).to_string()],
            Self::ReadBoxDi { input } => vec![input.to_string()],
            Self::Acs2Pcs { joints_deg, tool, user_frame } => numbers(&[*joints_deg, *tool, *user_frame].concat()),
        }
    }

    /// Reads a message, without its `;`.
    ///
    /// # Errors
    /// [`HansSyntax::UnknownCommand`] and [`HansSyntax::Arguments`].
    pub fn parse(message: &str) -> Result<Self, HansSyntax> {
        let fields = fields(message);
        let (name, rest) = fields.split_first().ok_or_else(|| HansSyntax::UnknownCommand(String::new()))?;
        if let Some(command) = HansCommand::ALL.iter().find(|command| command.name() == *name) {
            let robot: &[&str] = if command.has_robot() { &["0"] } else { &[] };
            return if rest == robot { Ok(Self::Plain(*command)) } else { Err(HansSyntax::Arguments((*name).to_owned())) };
        }
        let arguments = rest.split_first().filter(|(robot, _)| **robot == "0").map_or(&[][..], |(_, arguments)| arguments);
        let parsed = match *name {
            "SetOverride" => reals(arguments).map(|[fraction]| Self::SetOverride { fraction }),
            "WayPoint" => HansWayPoint::parse(arguments).map(|point| Self::WayPoint(Box::new(point))),
            "StartPushMovePath" => named(arguments).map(|(name, [speed_fraction, radius_mm])| Self::StartPushMovePath {
                name,
                speed_fraction,
                radius_mm,
            }),
            "PushMovePathJ" => named(arguments).map(|(name, joints_deg)| Self::PushMovePathJ { name, joints_deg }),
            "EndPushMovePath" => named(arguments).map(|(name, [])| Self::EndPushMovePath { name }),
            "ReadMovePathState" => named(arguments).map(|(name, [])| Self::ReadMovePathState { name }),
            "MovePath" => named(arguments).map(|(name, [])| Self::MovePath { name }),
            "StartServo" => reals(arguments).map(|[argument, lookahead_secs]| Self::StartServo { argument, lookahead_secs }),
            "PushServoJ" => reals(arguments).map(|joints_deg| Self::PushServoJ { joints_deg }),
            "SetBoxDO" => box_output(rest),
            "ReadBoxDI" => box_input(rest),
            "ACS2PCS" => acs2pcs(arguments),
            _ => return Err(HansSyntax::UnknownCommand((*name).to_owned())),
        };
        parsed.ok_or_else(|| HansSyntax::Arguments((*name).to_owned()))
    }
}

/// A name, then numbers.
fn named<const N: usize>(arguments: &[&str]) -> Option<(String, [f64; N])> {
    let (name, rest) = arguments.split_first()?;
    Some(((*name).to_owned(), reals(rest)?)).filter(|(name, _)| !name.is_empty())
}

fn box_output(rest: &[&str]) -> Option<HansRequest> {
    let [output, level] = rest else { return None };
    let is_on = ["0", "1"].iter().position(|known| known == level)? == 1;
    Some(HansRequest::SetBoxDo { output: output.parse().ok()?, is_on })
}

fn box_input(rest: &[&str]) -> Option<HansRequest> {
    let [input] = rest else { return None };
    Some(HansRequest::ReadBoxDi { input: input.parse().ok()? })
}

fn acs2pcs(arguments: &[&str]) -> Option<HansRequest> {
    let joints_deg = reals(arguments.get(..6)?)?;
    Some(HansRequest::Acs2Pcs { joints_deg, tool: reals(arguments.get(6..12)?)?, user_frame: reals(arguments.get(12..)?)? })
}

impl HansWayPoint {
    fn arguments(&self) -> Vec<String> {
        let flag = |value: bool| i32::from(value).to_string();
        let mut fields: Vec<String> = self.pose.iter().chain(&self.joints_deg).map(|value| number(*value)).collect();
        fields.extend([self.tool.clone(), self.user_frame.clone()]);
        fields.extend([self.speed, self.acceleration, self.radius_mm].map(number));
        // Then seek, its input and the input's level: moves here wait for no input.
        fields.extend([flag(self.is_linear), flag(self.is_joint_target), flag(false), flag(false), flag(false)]);
        fields.push(self.command_id.clone());
        fields
    }

    fn parse(fields: &[&str]) -> Option<Self> {
        let &[.., tool, user_frame, speed, acceleration, radius, kind, joint_target, _seek, _bit, _state, id] = fields else {
            return None;
        };
        let flag = |field: &str| ["0", "1"].iter().position(|known| *known == field).map(|index| index == 1);
        Some(Self {
            pose: reals(fields.get(..6)?)?,
            joints_deg: reals(fields.get(6..fields.len() - 11)?)?,
            tool: tool.to_owned(),
            user_frame: user_frame.to_owned(),
            speed: real(speed)?,
            acceleration: real(acceleration)?,
            radius_mm: real(radius)?,
            is_linear: flag(kind)?,
            is_joint_target: flag(joint_target)?,
            command_id: id.to_owned(),
        })
    }
}
