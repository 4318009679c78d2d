"""The reference aircraft's mass, geometry and limits: model.md, "State and integration", unless said otherwise."""

GRAVITY = 9.81  # m/s²
MASS = 9295.44  # kg
INERTIA_X = 12874.8  # kg·m²
INERTIA_Y = 75673.6  # kg·m²
INERTIA_Z = 85552.1  # kg·m²
INERTIA_XZ = 1331.4  # kg·m²
WING_AREA = 27.87  # m²
WING_SPAN = 9.144  # m
MEAN_CHORD = 3.45  # m
ENGINE_ANGULAR_MOMENTUM = 216.9  # kg·m²/s
CENTRE_OF_GRAVITY_SHIFT = 0.05  # chords: reference 0.35 − actual 0.30
