"""The tests of `test_sim_rows_*.py` are complete: every row of design/autopilots.md has a test that names it."""

import re
from pathlib import Path

import pytest
import test_sim_rows_failsafes
import test_sim_rows_in_flight
import test_sim_rows_missions
import test_sim_rows_stops

MODULES = (test_sim_rows_missions, test_sim_rows_stops, test_sim_rows_failsafes, test_sim_rows_in_flight)
DESIGN = Path(__file__).parents[3] / "shared" / "design" / "autopilots.md"
ROWS = {
    # How a row begins, and words of the names of the tests that show it.
    "Timeouts by the MAVLink": ["asks_with_mission_request", "asks_first_with_request_int", "timeouts_the_server"],
    "On silence, do not blindly": ["a_blind_restart"],
    "ArduPilot uploads are NOT atomic": ["uploads_are_not_atomic", "a_timed_out_upload_leaves_a_mix"],
    "A download is never identical": [
        "item_0_is_home",
        "jump_targets_count_home",
        "ardupilot_what_a_download_rewrites",
        "px4_what_a_download_rewrites",
        "opaque_id",
    ],
    "ArduPilot: MISSION_CLEAR_ALL": ["clear_all_types"],
    "Unused parameters are 0": ["refuses_nan"],
    "PX4: NAV_DELAY and DO_CHANGE_SPEED": ["need_the_frame_mission", "vertex_counts_disagree"],
    "PX4: ACK ACCEPTED does not": ["accepted_does_not_mean_flyable"],
    "Lossy links": ["lossy_links"],
    "Multirotors hold ground speed": ["hold_ground_speed", "cap_the_plan", "sends_the_ground_speed_again"],
    "PX4: a second TAKEOFF": [
        "second_take_off",
        "land_delay_waypoint_straight_above",
        "distant_waypoint",
        "land_disarm_waypoint_above",
    ],
    "ArduPilot: LAND disarms": ["land_disarms_and_resets", "continue_after_land"],
    "One mission per leg": ["one_mission_per_leg"],
    "Re-arm trap": ["rearm_trap", "rearming_needs_224", "must_start_with_a_take_off"],
    "The final LAND gives no": ["final_land_gives_no_item_reached"],
    "HOME moves when arming": ["home_moves_when_arming"],
    "Staying armed on a pad": ["an_armed_hold_leaves_by_the_clock"],
    "ArduPilot's battery percentage": ["battery_percentage_only_falls", "a_reboot_on_the_pad"],
    "ArduPilot: RALLY_LIMIT_KM": ["rally_limit", "nearest_of_home_and_rally", "fence_type_7", "rtl_height"],
    "Several inclusion areas": ["several_inclusion_areas", "divert_paths_too"],
    "Link loss, to finish the leg": [
        "link_loss_to_finish_the_leg",
        "remote_control_loss",
        "goes_on_landing",
        "battery_actions_and_thresholds",
    ],
    "Only heartbeats from SYSID_MYGCS": ["only_heartbeats_of_sysid_mygcs", "second_station_with_our_id"],
    "When our program ends": ["link_loss_to_finish_the_leg"],
    "PX4: an upload while flying": [
        "without_current_skips_waypoints",
        "with_current_on_the_right_item",
        "take_off_first_and_current",
        "infeasible_upload_in_flight",
    ],
    "ArduPilot: pause and continue": [
        "pause_and_continue",
        "new_items_act_as_soon",
        "hold_upload_set_current_resume",
        "unverified_divert",
    ],
    "A pilot's mode switch": ["a_pilots_mode_switch_wins", "another_stations_disarm_or_mission_change"],
    "ArduPilot streams nothing": ["streams_nothing_useful", "needs_40_s_after_boot"],
    "PX4 VFR_HUD.airspeed": ["airspeed_is_never_to_be_trusted"],
    "Wind: PX4 WIND_COV": ["wind_cov_is_alive", "wind_comes_at_4_hz"],
    "Batteries in both simulators": ["soc_may_jump"],
}
ELSEWHERE = {
    # Rows about skyway rather than about an autopilot: the file that has their tests.
    "ArduPilot renamed parameters": "link/test_firmware_versions.py",
    "PX4 builds without the payload": "link/test_firmware_versions.py",
    "`RTL_TYPE` 5": "link/test_firmware_versions.py",
    "The clock of PX4 SITL": "link/test_vehicle_time.py",
    "ArduPilot's EKF wind was far off": "link/test_lean_limit.py",
    "The default `ANGLE_MAX`": "link/test_lean_limit.py",
    "A wait in preflight": "link/test_supervisor.py",
    "`--pads manual` with `--yes`": "link/test_supervisor.py",
    "Payload: PX4 does not log": "link/test_supervisor.py",
}


def test_every_row_listed_here_has_tests_that_name_it_and_none_is_left_over():
    names = [name for module in MODULES for name in vars(module) if name.startswith("test_row_")]
    for row, words in ROWS.items():
        for word in words:
            assert [name for name in names if word in name], f"{row}: no test about {word}"
    listed = {word for words in ROWS.values() for word in words}
    assert [name for name in names if not any(word in name for word in listed)] == []


def test_every_row_of_the_design_is_listed_here():
    if not DESIGN.is_file():
        pytest.skip(f"{DESIGN} is not here: the list cannot be compared")
    bullets = [line[2:] for line in DESIGN.read_text(encoding="utf-8").splitlines() if re.match(r"- \S", line)]
    assert len(bullets) > 25
    assert [b[:60] for b in bullets if not any(b.startswith(row) for row in (*ROWS, *ELSEWHERE))] == []
    assert [row for row in (*ROWS, *ELSEWHERE) if not any(b.startswith(row) for b in bullets)] == []
