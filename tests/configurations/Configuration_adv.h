#define LIN_ADVANCE
#define ADVANCE_K { 0.08 }
#define HOMING_BUMP_MM { 5, 5, 2 }
#define HOMING_BUMP_DIVISOR { 2, 2, 4 }
#define X_CURRENT 580
#define X_MICROSTEPS 16
#define STEALTHCHOP_XY
#define BLTOUCH_HS_MODE true
#define BLTOUCH_SET_5V_MODE
