/* A bed slinger, written for these tests in the form of
   Marlin's configuration. */
#define CUSTOM_MACHINE_NAME "Slinger"
#define MOTHERBOARD BOARD_RAMPS
//#define COREXY
#define X_DRIVER_TYPE TMC2209
#define X_BED_SIZE 220
#define X_MIN_POS 0
#define X_MAX_POS X_BED_SIZE
#define Y_MIN_POS -5
#define Y_MAX_POS (X_BED_SIZE - 10)
#define Z_MIN_POS 0
#define Z_MAX_POS 240
#define X_HOME_DIR -1
#define Y_HOME_DIR -1
#define Z_HOME_DIR -1
#define DEFAULT_AXIS_STEPS_PER_UNIT   { 80, 80, 400, 93.5 } // of each axis
#define DEFAULT_MAX_FEEDRATE          { 250, 250, 10, 50 }
#define DEFAULT_MAX_ACCELERATION      { 1200, 1200, 120, 5000 }
#define DEFAULT_ACCELERATION          1000
#define DEFAULT_RETRACT_ACCELERATION  1100
#define DEFAULT_TRAVEL_ACCELERATION   1300
#define CLASSIC_JERK
#if ENABLED(CLASSIC_JERK)
  #define DEFAULT_XJERK 10.0
  #define DEFAULT_ZJERK 0.4
#else
  #define JUNCTION_DEVIATION_MM 0.013
#endif
#define HOMING_FEEDRATE_MM_M { (50*60), (50*60), (4*60) }
#define X_MIN_ENDSTOP_HIT_STATE LOW
#define BLTOUCH
#define USE_PROBE_FOR_Z_HOMING
#define NOZZLE_TO_PROBE_OFFSET { 10, -8, -1.5 }
#define Z_SAFE_HOMING_X_POINT 110
#define TEMP_SENSOR_0 5
#define TEMP_SENSOR_BED 998
#define HEATER_0_MAXTEMP 275
#define DEFAULT_Kp 22.95
#define AUTO_BED_LEVELING_BILINEAR
#define INVERT_Y_DIR true
#define EXTRUDE_MINTEMP 170
