"""The columns of a flight's record, one row per control step."""

RECORD = {
    "positions_m": slice(0, 3),
    "quaternions_wxyz": slice(3, 7),
    "velocities_m_s": slice(7, 10),
    "accelerations_m_s2": slice(10, 13),
    "angular_velocities_rad_s": slice(13, 16),
    "angular_accelerations_rad_s2": slice(16, 19),
    "thrust_commands_n": slice(19, 23),
    "thrusts_n": slice(23, 27),
    "winds_m_s": slice(27, 30),
}
"""Columns of each field of `Flight`."""
RECORD_COLUMNS = 30
