PRINT_START
M83
;LAYER_CHANGE
;Z:0.2
;HEIGHT:0.2
G1 Z0.2 F600
G1 X60 Y60 F9000
;TYPE:External perimeter
G1 X90 E1.2 F3600
G1 Y90 E1.2
G1 X60 E1.2
G1 Y60 E1.2
;TYPE:Solid infill
G1 X90 Y90 E1.68
;LAYER_CHANGE
;Z:0.4
;HEIGHT:0.2
G1 Z0.4 F600
G1 X60 Y60 F9000
;TYPE:External perimeter
G1 X90 E1.2 F3600
G1 Y90 E1.2
G1 X60 E1.2
G1 Y60 E1.2
;TYPE:Solid infill
G1 X90 Y90 E1.68
PRINT_END
; prusaslicer_config = begin
; bed_temperature = 62
; first_layer_bed_temperature = 65
; first_layer_temperature = 225
; temperature = 218
; prusaslicer_config = end
