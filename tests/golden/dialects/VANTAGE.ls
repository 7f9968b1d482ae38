/PROG  VANTAGE
/ATTR
OWNER		= MNEDITOR;
COMMENT		= "PLAN 0123456789a";
PROG_SIZE	= 0;
CREATE		= DATE 00-00-00  TIME 00:00:00;
MODIFIED	= DATE 00-00-00  TIME 00:00:00;
FILE_NAME	= ;
VERSION		= 0;
LINE_COUNT	= 83;
MEMORY_SIZE	= 0;
PROTECT		= READ_WRITE;
TCD:  STACK_SIZE	= 0,
      TASK_PRIORITY	= 50,
      TIME_SLICE	= 0,
      BUSY_LAMP_OFF	= 0,
      ABORT_REQUEST	= 0,
      PAUSE_REQUEST	= 0;
DEFAULT_GROUP	= 1,1,*,*,*;
CONTROL_CODE	= 00000000 00000000;
/APPL
/MN
   1:  !Vantage scan program. File name: ;
   2:  !VANTAGE.LS ;
   3:  !Plan SHA-256 ;
   4:  !0123456789abcdef0123456789abcdef ;
   5:  !0123456789abcdef0123456789abcdef ;
   6:  !Setup 1, 2 scans, predicted ;
   7:  !cycle 16.5 s ;
   8:  !Cell e05-transcan, robot ;
   9:  !hans-e05, turntable minas-a6-500 ;
  10:  !Units: deg, percent of rated, s. ;
  11:  !WARNING: not safety-rated. ;
  12:  !Guarding, speed limits and stops ;
  13:  !belong to the cell's safety ;
  14:  !system. ;
  15:  !WARNING: run first at reduced ;
  16:  !speed, nobody in the cell, a ;
  17:  !hand on the stop. ;
  18:  !WARNING: checked in the model of ;
  19:  !the cell WITHOUT the part: what ;
  20:  !hits the part was not looked ;
  21:  !for. ;
  22:  !Payload to be set on the ;
  23:  !controller: 2.70 kg at the ;
  24:  !flange, and cables. ;
  25:  !Table: axis 1 of motion group 2. ;
  26:  !it moves with the arm. ;
  27:  !Each point is a stop: the paths ;
  28:  !between them were checked as ;
  29:  !straight joint moves. ;
  30:  !Scan: output 1 on for 0.1 s ;
  31:  !starts it. input 1 on ends it, ;
  32:  !after 30 s the program stops. ;
  33:  !Input 1 has to be off before the ;
  34:  !next scan: the program waits for ;
  35:  !that, 30 s at most, and then ;
  36:  !stops. ;
  37:  !Bring arm and table home by hand ;
  38:  !first: the first move goes ;
  39:  !there, slowly, on a way that was ;
  40:  !not checked. ;
  41:  !Joints are the controller's own, ;
  42:  !J3 coupled to J2 where it is so. ;
  43:  !Positions are in joints, of ;
  44:  !UFRAME 0 and UTOOL 1: select ;
  45:  !these in both groups first. None ;
  46:  !is selected here, and a ;
  47:  !controller may refuse others ;
  48:  !(INTP-253). ;
  49:  !Sets $WAITTMOUT, the time-out of ;
  50:  !waits in every program, and ;
  51:  !leaves it so: others have to set ;
  52:  !their own. ;
  53:  $WAITTMOUT=3000 ;
  54:J P[1] 5% FINE ;
  55:  !to viewpoint 4 ;
  56:J P[2] 25% FINE ACC25 ;
  57:J P[3] 25% FINE ACC25 ;
  58:J P[4] 25% FINE ACC25 ;
  59:  WAIT    .30(sec) ;
  60:  !scan viewpoint 4, level 5 ;
  61:  WAIT DI[1]=OFF TIMEOUT,LBL[98] ;
  62:  DO[1]=ON ;
  63:  WAIT    .10(sec) ;
  64:  DO[1]=OFF ;
  65:  WAIT DI[1]=ON TIMEOUT,LBL[99] ;
  66:  !to viewpoint 0 ;
  67:J P[5] 25% FINE ACC25 ;
  68:  WAIT    .30(sec) ;
  69:  !scan viewpoint 0, level 5 ;
  70:  WAIT DI[1]=OFF TIMEOUT,LBL[98] ;
  71:  DO[1]=ON ;
  72:  WAIT    .10(sec) ;
  73:  DO[1]=OFF ;
  74:  WAIT DI[1]=ON TIMEOUT,LBL[99] ;
  75:  !home ;
  76:J P[6] 25% FINE ACC25 ;
  77:  END ;
  78:  LBL[99:NO ANSWER] ;
  79:  MESSAGE[SCANNER DID NOT ANSWER] ;
  80:  ABORT ;
  81:  LBL[98:STILL ON] ;
  82:  MESSAGE[SCANNER INPUT STAYS ON] ;
  83:  ABORT ;
/POS
P[1:"HOME"]{
   GP1:
	UF : 0, UT : 1,
	J1=     0.000 deg,	J2=   -30.000 deg,	J3=    60.000 deg,
	J4=     0.000 deg,	J5=    30.000 deg,	J6=     0.000 deg
   GP2:
	UF : 0, UT : 1,
	J1=     0.000 deg
};
P[2]{
   GP1:
	UF : 0, UT : 1,
	J1=     0.000 deg,	J2=   -30.000 deg,	J3=    60.000 deg,
	J4=     0.000 deg,	J5=    30.000 deg,	J6=     0.000 deg
   GP2:
	UF : 0, UT : 1,
	J1=    30.000 deg
};
P[3]{
   GP1:
	UF : 0, UT : 1,
	J1=     5.000 deg,	J2=   -30.000 deg,	J3=    60.000 deg,
	J4=     0.000 deg,	J5=    30.000 deg,	J6=     0.000 deg
   GP2:
	UF : 0, UT : 1,
	J1=    30.000 deg
};
P[4]{
   GP1:
	UF : 0, UT : 1,
	J1=    10.123 deg,	J2=   -33.000 deg,	J3=    64.000 deg,
	J4=     5.000 deg,	J5=    24.000 deg,	J6=     7.000 deg
   GP2:
	UF : 0, UT : 1,
	J1=    45.000 deg
};
P[5]{
   GP1:
	UF : 0, UT : 1,
	J1=   -10.000 deg,	J2=   -33.000 deg,	J3=    64.000 deg,
	J4=     0.000 deg,	J5=    30.000 deg,	J6=    -7.654 deg
   GP2:
	UF : 0, UT : 1,
	J1=   -20.000 deg
};
P[6]{
   GP1:
	UF : 0, UT : 1,
	J1=     0.000 deg,	J2=   -30.000 deg,	J3=    60.000 deg,
	J4=     0.000 deg,	J5=    30.000 deg,	J6=     0.000 deg
   GP2:
	UF : 0, UT : 1,
	J1=     0.000 deg
};
/END
