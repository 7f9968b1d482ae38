MODULE vantage
  ! Vantage scan program. File name: vantage.mod
  ! Plan SHA-256 0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef
  ! Setup 1, 2 scans, predicted cycle 16.5 s
  ! Cell e05-transcan, robot hans-e05, turntable minas-a6-500
  ! Units: deg, s.
  ! WARNING: not safety-rated. Guarding, speed limits and stops belong to the cell's safety system.
  ! WARNING: run first at reduced speed, nobody in the cell, a hand on the stop.
  ! WARNING: checked in the model of the cell WITHOUT the part: what hits the part was not looked for.
  ! Payload to be set on the controller: 2.70 kg at the flange, and cables.
  ! Table: external axis 1 of the joint targets; it moves with the arm.
  ! Each point is a stop: the paths between them were checked as straight joint moves.
  ! Scan: output 1 on for 0.1 s starts it; input 1 on ends it, after 30 s the program stops. Input 1 has
  ! to be off before the next scan: the program waits for that, 30 s at most, and then stops.
  ! Signals: scan_output and scan_input stand for the configured signals DO_1 and DI_1; change the names
  ! below.
  ! tool0 carries no load: replace it by the scanner's tool data before the first run.
  ! Before anything moves by program: with the arm in the posture of home, compare the joint angles that
  ! the controller shows with those of p0.
  ! Joint 3 is counted from the upper arm: when joint 2 is jogged alone, the forearm has to turn with
  ! it. Else (ABB arms with a parallel rod, such as IRB 2400, 4400, 6400) do not run: the robot's model
  ! needs joint_3_from_ground = true.
  ! Call vantage_run;
  LOCAL CONST jointtarget p0:=[[0.0000,-30.0000,60.0000,0.0000,30.0000,0.0000],[0.0000,9E9,9E9,9E9,9E9,9E9]];
  LOCAL CONST jointtarget p1:=[[0.0000,-30.0000,60.0000,0.0000,30.0000,0.0000],[30.0000,9E9,9E9,9E9,9E9,9E9]];
  LOCAL CONST jointtarget p2:=[[5.0000,-30.0000,60.0000,0.0000,30.0000,0.0000],[30.0000,9E9,9E9,9E9,9E9,9E9]];
  LOCAL CONST jointtarget p3:=[[10.1235,-33.0000,64.0000,5.0000,24.0000,7.0000],[45.0000,9E9,9E9,9E9,9E9,9E9]];
  LOCAL CONST jointtarget p4:=[[-10.0000,-33.0000,64.0000,0.0000,30.0000,-7.6543],[-20.0000,9E9,9E9,9E9,9E9,9E9]];
  LOCAL CONST jointtarget p5:=[[0.0000,-30.0000,60.0000,0.0000,30.0000,0.0000],[0.0000,9E9,9E9,9E9,9E9,9E9]];
  LOCAL CONST string scan_output_name:="DO_1";
  LOCAL CONST string scan_input_name:="DI_1";
  LOCAL VAR signaldo scan_output;
  LOCAL VAR signaldi scan_input;
  ! The paths begin at home; from anywhere else they were not checked.
  LOCAL PROC require_home()
    VAR jointtarget now;
    now:=CJointT();
    IF Abs(now.robax.rax_1-p0.robax.rax_1)>0.5
      OR Abs(now.robax.rax_2-p0.robax.rax_2)>0.5
      OR Abs(now.robax.rax_3-p0.robax.rax_3)>0.5
      OR Abs(now.robax.rax_4-p0.robax.rax_4)>0.5
      OR Abs(now.robax.rax_5-p0.robax.rax_5)>0.5
      OR Abs(now.robax.rax_6-p0.robax.rax_6)>0.5
      OR Abs(now.extax.eax_a-p0.extax.eax_a)>0.5 THEN
      ErrWrite "Vantage: not at home","Bring arm and table to p0 by hand, then start again.";
      EXIT;
    ENDIF
  ENDPROC
  LOCAL PROC scan()
    WaitDI scan_input,0\MaxTime:=30.000;
    SetDO scan_output,1;
    WaitTime 0.100;
    SetDO scan_output,0;
    WaitDI scan_input,1\MaxTime:=30.000;
  ENDPROC
  PROC vantage_run()
    AliasIO scan_output_name,scan_output;
    AliasIO scan_input_name,scan_input;
    require_home;
    ! to viewpoint 4
    AccSet 25,100;
    MoveAbsJ p1\NoEOffs,vmax\T:=3.167,fine,tool0;
    MoveAbsJ p2\NoEOffs,vmax\T:=0.348,fine,tool0;
    MoveAbsJ p3\NoEOffs,vmax\T:=1.834,fine,tool0;
    WaitTime\InPos,0.300;
    ! scan viewpoint 4, brightness 5
    scan;
    ! to viewpoint 0
    MoveAbsJ p4\NoEOffs,vmax\T:=6.278,fine,tool0;
    WaitTime\InPos,0.300;
    ! scan viewpoint 0, brightness 5
    scan;
    ! home
    MoveAbsJ p5\NoEOffs,vmax\T:=2.278,fine,tool0;
    AccSet 100,100;
  ENDPROC
ENDMODULE
