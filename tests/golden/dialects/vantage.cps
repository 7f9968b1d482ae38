# Vantage scan program. File name: vantage.cps
# Plan SHA-256 0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef
# Setup 1, 2 scans, predicted cycle 18.5 s
# Cell e05-transcan, robot hans-e05, turntable minas-a6-500
# Units: deg, deg/s, deg/s2, s.
# WARNING: not safety-rated. Guarding, speed limits and stops belong to the cell's safety system.
# WARNING: run first at reduced speed, nobody in the cell, a hand on the stop.
# WARNING: checked in the model of the cell WITHOUT the part: what hits the part was not looked for.
# Payload to be set on the controller: 2.70 kg at the flange, and cables.
# Table: turned by the sender at each @table line, never while the arm moves.
# Each point is a stop: the paths between them were checked as straight joint moves.
# Scan: output 1 on for 0.1 s starts it; input 1 on ends it, after 30 s the program stops. Input 1 has
# to be off before the next scan: the program waits for that, 30 s at most, and then stops.
# Targets are joints: no frame changes the motion. Each WayPoint names tool frame TCP and user frame
# Base all the same; where the controller has no frames of these names, put names of its own in their
# place.
# Send each line that begins with a letter as it stands, without the line end, and wait for its
# Name,OK,...,; before the next; on Name,Fail,code,; stop. Lines with @ are for the sender:
# @home J1 J2 J3 J4 J5 J6 TABLE: stop unless ReadActPos,0,; and the table are within 0.5 deg of this.
# @motion: poll ReadRobotState,0,; until moving [0] is 0, blending done [11] is 1 and in position [12]
# is 1.
# @table A: turn the table to A deg and wait until it stands; the arm stands meanwhile.
# @wait S: wait S seconds.
# @off N S: poll ReadBoxDI,N,; until it is 0; stop when it is not within S seconds.
# @input N S: poll ReadBoxDI,N,; until it is 1; stop when it is not within S seconds.
# @scan N B: the next pulse captures viewpoint N; the scanner's brightness level has to be B.
@home 0.0000 -30.0000 60.0000 0.0000 30.0000 0.0000 0.0000
# to viewpoint 4
@table 30.0000
WayPoint,0,0,0,0,0,0,0,5.0000,-30.0000,60.0000,0.0000,30.0000,0.0000,TCP,Base,22.4885,179.9085,0,0,1,0,0,0,2,;
@motion
@table 45.0000
WayPoint,0,0,0,0,0,0,0,10.1235,-33.0000,64.0000,5.0000,24.0000,7.0000,TCP,Base,22.4885,179.9085,0,0,1,0,0,0,4,;
@motion
@wait 0.300
# scan viewpoint 4, brightness 5
@scan 4 5
@off 1 30.000
SetBoxDO,1,1,;
@wait 0.100
SetBoxDO,1,0,;
@input 1 30.000
# to viewpoint 0
@table -20.0000
WayPoint,0,0,0,0,0,0,0,-10.0000,-33.0000,64.0000,0.0000,30.0000,-7.6543,TCP,Base,22.4885,179.9085,0,0,1,0,0,0,6,;
@motion
@wait 0.300
# scan viewpoint 0, brightness 5
@scan 0 5
@off 1 30.000
SetBoxDO,1,1,;
@wait 0.100
SetBoxDO,1,0,;
@input 1 30.000
# home
@table 0.0000
WayPoint,0,0,0,0,0,0,0,0.0000,-30.0000,60.0000,0.0000,30.0000,0.0000,TCP,Base,22.4885,179.9085,0,0,1,0,0,0,8,;
@motion
