"""Benchmarks: small ones run, instances are what was published."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT))

from benchmarks import __main__ as everything  # noqa: E402
from benchmarks.cases.instances import FOLDER, make_instance, make_long, read_instance  # noqa: E402
from benchmarks.cases.melbourne import melbourne  # noqa: E402
from benchmarks.cases.networks import geometric, random_pairs  # noqa: E402
from benchmarks.fleet import bench_aboard  # noqa: E402
from benchmarks.online import bench_rolling, rolling_risk, rolling_why  # noqa: E402
from benchmarks.planners import bench_gap, bench_planners, bench_promises  # noqa: E402
from benchmarks.planners.paper import CUT_OFF, NO_ROUTE, SOLVED, PaperRun, rows  # noqa: E402
from benchmarks.planners.trials import ROLLING, case_of, contenders  # noqa: E402
from benchmarks.tables import pictures, report, seeds  # noqa: E402
from benchmarks.tables.figure import Figure, machine  # noqa: E402
from benchmarks.tables.memory import peak_memory_mb  # noqa: E402
from skyway.models.base.errors import InputError  # noqa: E402
from skyway.models.base.parameters import with_settings  # noqa: E402
from skyway.planner.evaluation.evaluate import NO_ERRORS, fly_policy  # noqa: E402
from skyway.planner.online.evaluated import RollingRobust  # noqa: E402
from skyway.planner.parameters.planner import PlannerParameters  # noqa: E402
from skyway.planner.plan import plan  # noqa: E402
from skyway.planner.problem.problem import Problem  # noqa: E402
from skyway.planner.registry import CLAIRVOYANT_PLANNERS, PLANNERS, ROBUST  # noqa: E402


def quiet(_):
    pass


def test_a_figure_says_whether_its_target_is_met_and_by_how_much_it_is_missed():
    assert Figure("a", 4.0, "ms", 5.0).verdict == "met"
    assert Figure("a", 6.0, "ms", 5.0).verdict == "missed by 1 ms (20%)"
    assert Figure("a", 6.0, "ms").verdict == ""
    assert "target 5 ms" in Figure("a", 6.0, "ms", 5.0).line()
    assert {"processor", "cores", "Python", "numpy", "numba"} <= set(machine())


def test_all_benchmarks_keep_their_figures_and_say_when_one_could_not_be_completed(tmp_path, monkeypatch, capsys):
    file = tmp_path / "figures.json"
    monkeypatch.setattr(everything, "measured", lambda name: [Figure(name, 1.0)])
    assert everything.main(["speed", "--json", str(file)]) == 0
    document = json.loads(file.read_text())
    assert document["machine"]["commit"]
    assert [one["what"] for one in document["figures"]] == ["speed"]

    def broken(name):
        raise KeyboardInterrupt

    monkeypatch.setitem(everything.SCRIPTS, "sim", ("no.such.module", []))
    assert everything.main(["sim"]) == 1
    assert "failed: " in capsys.readouterr().out
    monkeypatch.setattr(everything, "measured", lambda name: broken(name) if name == "ies" else [Figure(name, 2.0)])
    with pytest.raises(KeyboardInterrupt):
        everything.main(["speed", "ies", "--json", str(file)])
    assert [one["value"] for one in json.loads(file.read_text())["figures"]] == [2.0]
    with pytest.raises(SystemExit):
        everything.main(["speed", "--json", str(tmp_path / "nowhere" / "x.json")])
    assert "--json: " in capsys.readouterr().err


@pytest.mark.parametrize("name", ["new-york-0.7", "geometric-100-0.5", "geometric-1000-0.9"])
def test_published_instances_are_what_their_seeds_make(name):
    published = read_instance(FOLDER / f"{name}.json")
    made = make_instance(published.network, published.utilisation, seed=published.network_seed)
    assert made == published
    scenario = published.scenario()
    assert scenario.load.utilisation(scenario.network.pads).mean() == pytest.approx(published.utilisation)


def test_the_instances_of_melbourne_are_what_the_real_data_make(shared_data):
    published = read_instance(FOLDER / "melbourne-0.5.json")
    assert make_instance("melbourne", 0.5) == published
    assert len(melbourne().network) == 63


def test_planners_are_told_the_energy_errors_of_the_runs():
    instance = read_instance(FOLDER / "new-york-0.5.json")
    assert instance.errors.energy.sd_between == 0.029
    assert {drone.energy_belief for drone in instance.scenario().drones} == {instance.errors.energy}
    calm = replace(instance, errors=NO_ERRORS).scenario()
    assert {drone.energy_belief for drone in calm.drones} == {NO_ERRORS.energy}


def test_another_network_than_the_instances_is_refused(tmp_path):
    other = replace(read_instance(FOLDER / "geometric-100-0.5.json"), network_seed=2)
    with pytest.raises(InputError, match="another network"):
        other.scenario()
    (tmp_path / "x.json").write_text("{}")
    with pytest.raises(InputError, match="no benchmark instance"):
        read_instance(tmp_path / "x.json")


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"deliveries": []}, "deliveries: has none"),
        ({"runs": 0}, "runs: out of range"),
        ({"runs": "many"}, "runs: out of range"),
        ({"truth_seed": -1}, "truth_seed: out of range"),
        ({"more": 1}, "is no benchmark instance"),
    ],
)
def test_an_instance_that_cannot_be_flown_is_one_error_that_names_the_file(tmp_path, change, told):
    file = tmp_path / "x.json"
    file.write_text(json.dumps(json.loads((FOLDER / "new-york-0.5.json").read_text()) | change))
    with pytest.raises(InputError, match=re.escape(str(file)) + ".*" + told):
        read_instance(file)


def test_a_network_that_does_not_exist_is_refused():
    for name in ("atlantis", "geometric-x", "geometric-", "geometric--5"):
        with pytest.raises(InputError, match="no such network"):
            replace(read_instance(FOLDER / "new-york-0.5.json"), network=name).scenario()


def test_random_networks_are_the_same_from_the_same_seed_and_requests_can_be_flown():
    one, two, three = geometric(100, 1), geometric(100, 1), geometric(100, 2)
    assert one.network.stations == two.network.stations
    assert one.network.stations != three.network.stations
    assert one.network.distance_m.max() <= 10_000.0
    pairs = random_pairs(one.network, 5, 1, least_m=20_000.0, most_m=60_000.0)
    assert len(pairs) == 5
    assert pairs == random_pairs(two.network, 5, 1, least_m=20_000.0, most_m=60_000.0)


def test_every_planner_is_tried_and_pfs_in_both_ways_of_recharging():
    tried = {rival.planner for rival in contenders(46)}
    assert tried | set(CLAIRVOYANT_PLANNERS) == {*PLANNERS, ROLLING}
    assert {rival.recharge for rival in contenders(10_000) if rival.planner == "pfs"} == {"full", "enough"}
    assert not {"pfs-strict", ROLLING} & {rival.planner for rival in contenders(10_000)}


def test_a_search_that_was_cut_off_is_counted_and_never_averaged_into_delivery_times():
    def run(number, planner, status, delivery_s):
        return PaperRun(10, number, "a", "b", "2013-07-10", planner, status, 1.0, delivery_s, False)

    runs = [run(0, "pfs", SOLVED, 100.0), run(0, "ies", SOLVED, 90.0)]
    runs += [run(1, "pfs", SOLVED, 500.0), run(1, "ies", CUT_OFF, 400.0)]
    runs += [run(2, "pfs", NO_ROUTE, None), run(2, "ies", SOLVED, 60.0)]
    pfs, ies = rows(runs)
    assert (pfs.delivery_s, ies.delivery_s, ies.compared) == (100.0, 90.0, 1)
    assert (ies.solved, ies.cut_off, ies.no_route) == (2, 1, 0)
    assert (pfs.solved, pfs.cut_off, pfs.no_route) == (2, 0, 1)
    assert "≥ 1000.0" in report.markdown([], [pfs, ies], {}, [])


@pytest.mark.slow
def test_a_small_benchmark_writes_table_results_and_figures(tmp_path, monkeypatch):
    few = [rival for rival in contenders(46) if rival.planner in {"pfs-charge-aware", "shortest"}]
    monkeypatch.setattr("benchmarks.planners.trials.contenders", lambda _: few)
    monkeypatch.setattr("benchmarks.planners.trials.CLAIRVOYANT_PLANNERS", ("ies",))
    size = bench_planners.Size((FOLDER / "new-york-0.5.json",), 2, 3, (4,), 1, 0.5)
    told = []
    written = bench_planners.run(size, tmp_path / "out", progress=told.append)
    assert all(path.stat().st_size > 0 for path in written)
    text = (tmp_path / "out" / "planners.md").read_text()
    assert "## new-york-0.5" in text
    assert "only shapes can be compared" in text
    document = json.loads((tmp_path / "out" / "planners.json").read_text())
    assert document["schema"] == "skyway.benchmark-results/1"
    assert {row["planner"] for row in document["rows"]} >= {"shortest", "ies"}
    above = next(row["common"]["regret"] for row in document["rows"] if row["planner"] == "shortest")
    value, low, high = (f"{100.0 * above[name]:.0f}" for name in ("value", "low", "high"))
    assert f"| shortest | {value} [{low}, {high}] (0.0) |" in text, "at a glance, with the interval of so few days"
    assert document["machine"]["commit"]
    assert "![delivery time](delivery-time.svg)" in text
    assert any("new-york-0.5" in line for line in told)
    assert len(written) == 7
    told.clear()
    bench_planners.run(size, tmp_path / "out", keep=True, progress=told.append)
    assert not any("new-york-0.5" in line for line in told)
    assert json.loads((tmp_path / "out" / "planners.json").read_text())["rows"] == document["rows"]


NOTHING = bench_planners.Size((), 2, 3, (), 1, 0.5)
"""A benchmark without instances and without the paper's experiment."""


def test_results_are_neither_replaced_nor_mixed_with_others_unasked(tmp_path, monkeypatch):
    bench_planners.run(NOTHING, tmp_path, progress=quiet)
    before = (tmp_path / "planners.json").read_bytes()
    with pytest.raises(InputError, match="holds results already; --resume continues them, --force replaces them"):
        bench_planners.run(NOTHING, tmp_path, progress=quiet)
    with pytest.raises(InputError, match=r"conditions\.most_deliveries: .* \(got '2'\); measure with the same options"):
        bench_planners.run(replace(NOTHING, deliveries=100), tmp_path, keep=True, progress=quiet)
    fewer = with_settings(PlannerParameters(), ["robust.members=20"])
    with pytest.raises(InputError, match=r"conditions\.parameters: the results in this folder were not measured with"):
        bench_planners.run(NOTHING, tmp_path, keep=True, progress=quiet, parameters=fewer)
    with monkeypatch.context() as patch:
        patch.setattr(bench_planners, "PLANNERS", (*PLANNERS, "mine"))
        with pytest.raises(InputError, match=r"conditions\.planners: .*'mine'"):
            bench_planners.run(NOTHING, tmp_path, keep=True, progress=quiet)
    assert (tmp_path / "planners.json").read_bytes() == before
    bench_planners.run(NOTHING, tmp_path, keep=True, progress=quiet)
    bench_planners.run(replace(NOTHING, deliveries=100), tmp_path, force=True, progress=quiet)
    assert json.loads((tmp_path / "planners.json").read_text())["conditions"]["most_deliveries"] == 100


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        '{"schema": "skyway.benchmark-results/1"',
        '{"schema": "skyway.benchmark-results/1"}',
        '{"schema": "skyway.benchmark-results/1", "rows": [{}], "machine": {}, "paper_runs": []}',
        '{"schema": "skyway.benchmark-results/1", "rows": [], "machine": {"seconds": "?"}, "paper_runs": []}',
        '{"schema": "skyway.benchmark-results/1", "rows": [], "machine": {}, "paper_runs": []}',
    ],
)
def test_results_that_cannot_be_continued_are_one_error_and_stay(tmp_path, text):
    file = tmp_path / "planners.json"
    file.write_text(text)
    with pytest.raises(InputError, match=re.escape(str(file))):
        bench_planners.run(NOTHING, tmp_path, keep=True, progress=quiet)
    assert file.read_text() == text


def test_parts_of_the_benchmark_are_chosen_by_name(tmp_path):
    full = bench_planners.FULL
    one = bench_planners.chosen(full, ["new-york-0.5"])
    assert [file.stem for file in one.instances] == ["new-york-0.5"]
    assert one.nodes == ()
    both = bench_planners.chosen(full, ["geometric-100-", "paper"])
    assert len(both.instances) == 3
    assert both.nodes == full.nodes
    assert bench_planners.chosen(full, []) == full
    for wrong in ("new-yrok", ""):
        with pytest.raises(InputError, match="--instance: no such instance in this benchmark"):
            bench_planners.chosen(full, ["paper", wrong])
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="--output: the folder cannot be made"):
        bench_planners.run(NOTHING, tmp_path / "file", progress=quiet)


def test_figures_are_left_out_where_there_is_nothing_to_draw(tmp_path):
    assert pictures.draw(tmp_path, [], []) == []


def test_an_instance_whose_data_are_not_here_is_left_out_with_its_reason(tmp_path, monkeypatch):
    monkeypatch.setattr("benchmarks.cases.melbourne.DATA", tmp_path)
    melbourne.cache_clear()
    told = []
    size = bench_planners.Size((FOLDER / "melbourne-0.5.json",), 1, 1, (), 1, 0.5)
    bench_planners.run(size, tmp_path / "out", progress=told.append)
    melbourne.cache_clear()
    assert "the data of Melbourne are not here" in (tmp_path / "out" / "planners.md").read_text()


def test_the_long_instance_is_what_its_seed_makes_and_has_500_deliveries():
    published = read_instance(FOLDER / "new-york-0.5-125.json")
    assert published == make_long()
    assert len(published.deliveries) * published.runs == 500


def test_the_bound_in_the_wind_alone_is_below_every_plan():
    rows = list(bench_gap.measured(1, days=2, why=True, seed=4))
    assert rows
    for row in rows:
        assert row.bound_s <= row.parts["own stops"] * (1.0 + 1e-9)
        assert row.parts["own stops"] <= row.fixed_s * (1.0 + 1e-9)
        assert row.parts["best route"] <= row.fixed_s * (1.0 + 1e-9)
        assert row.days == 0 or row.day_bound_s <= min(row.day_fixed_s, row.rolling_s) * (1.0 + 1e-9)
    assert any("mean above bound" in figure.what for figure in bench_gap.figures_of(rows))


def test_promises_are_counted_on_days_that_no_forecast_held():
    found = list(bench_promises.measured(bench_promises.loaded(0.0), 2, days=2, runs=5, seed=3))
    assert sum(len(one.flown) for one in found) == 10 * len(found) > 0
    error, broken = bench_promises.figures_of(found, "New York")
    assert 0.0 <= error.value <= 100.0
    assert broken.value >= 0.0
    assert json.loads(json.dumps(found[0].document()))["days"][0]["runs"] == 5
    assert "0.95" in bench_promises.table(found)


@pytest.fixture
def long_instance():
    return read_instance(FOLDER / "new-york-0.5-125.json").cut(3, 1)


@pytest.mark.slow
def test_a_long_measurement_goes_on_where_it_was_broken_off(tmp_path, monkeypatch):
    few = tuple(one for one in bench_rolling.RIVALS if one.label in {"robust, rolling horizon", "pfs, full"})
    monkeypatch.setattr("benchmarks.online.bench_rolling.RIVALS", few)
    instance = read_instance(FOLDER / "new-york-0.5-125.json").cut(3, 1)
    told = []
    bench_rolling.run(instance.cut(1, 1), tmp_path / "rows.jsonl", progress=told.append)
    bench_rolling.run(instance, tmp_path / "rows.jsonl", part=(0, 2), progress=told.append)
    assert [row["number"] for row in bench_rolling.read(tmp_path / "rows.jsonl")] == [0, 2]
    assert len(told) == 2
    above = bench_rolling.figures_of(bench_rolling.read(tmp_path / "rows.jsonl"))[0]
    assert above.target == bench_rolling.ABOVE_BEST
    assert above.value > -1.0


def test_the_rolling_horizon_is_measured_alone_and_without_gusts_if_so_asked(tmp_path, monkeypatch, capsys):
    out = tmp_path / "rows.jsonl"
    asked = ["--alone", "--no-gusts", "--deliveries", "1", "--runs", "1", "--out", str(out)]
    monkeypatch.setattr("sys.argv", ["bench_rolling", *asked])
    assert bench_rolling.main() == 0
    (row,) = bench_rolling.read(out)
    assert set(row) == {"number", "day", bench_rolling.BEST, "robust, rolling horizon"}
    (best,), (ours,) = (row[name]["delivery_s"] for name in (bench_rolling.BEST, "robust, rolling horizon"))
    assert ours >= best * (1.0 - 1e-6)  # in gusts from behind it may be earlier
    said = capsys.readouterr().out
    assert "above exact" in said
    assert f"target {bench_rolling.ABOVE_BEST_IN_CALM:g} %" in said


def test_a_reserve_for_gusts_makes_the_clairvoyant_no_faster(long_instance):
    scenario = long_instance.scenario()
    for number in range(3):
        best, bound = rolling_why.clairvoyant_and_bound(case_of(scenario, long_instance, number, 1))
        assert 0.0 < best <= bound * (1.0 + 1e-9)


def test_perfect_information_about_wind_and_queues_is_that_of_the_run(long_instance):
    still = replace(long_instance, errors=NO_ERRORS)
    case = case_of(still.scenario(), still, 1, 1)
    best, _ = rolling_why.clairvoyant_and_bound(case)
    assert rolling_why.fly_informed(case, rolling_why.BOTH) == pytest.approx(best, rel=0.05)
    assert rolling_why.fly_informed(case, rolling_why.NOTHING) >= best * (1.0 - 1e-6)


def test_a_flight_is_flown_again_as_it_was_in_the_same_gusts(long_instance):
    case = case_of(long_instance.scenario(), long_instance, 1, 1)
    start = Problem(case.scenario, case.realizations.request, case.scenario.drone(long_instance.drone), case.forecast)
    policy = RollingRobust(start, case.realizations.errors)
    seen = []
    flown, _ = fly_policy(case.realizations, long_instance.drone, policy, np.array([0]), watch=seen.append)
    same = [again.charge_left(int(case.realizations.gust_key[0])) for again in seen]
    assert min(same) == pytest.approx(float(flown.lowest_soc[0]))
    assert seen[0].charge_left(1) != same[0]
    watch = rolling_risk.Watch(start.reserve, 30, np.random.default_rng(0))
    watch(seen[0])
    assert (watch.flights, 0.0 <= watch.broken <= 1.0) == (1, True)
    watch = rolling_risk.Watch(1.0, 30, np.random.default_rng(0))
    watch(seen[0])
    assert watch.broken == 1.0


def test_where_the_wind_closes_a_flight_for_hours_a_route_of_shorter_ones_is_better():
    instance = read_instance(FOLDER / "geometric-1000-0.5.json")
    case = case_of(instance.scenario(), instance, 2, 1)
    usual = with_settings(PlannerParameters(), ["robust.margins=0.12"])
    short = plan(case.scenario, case.request("enough"), planner=ROBUST, forecast=case.forecast, parameters=usual)
    patient = with_settings(usual, ["robust.long_wait=10"])
    long = plan(case.scenario, case.request("enough"), planner=ROBUST, forecast=case.forecast, parameters=patient)
    begin = short.problem.depart_s
    assert len(short.robust.candidates) > len(long.robust.candidates)
    assert short.outcome.mean_s - begin < 0.95 * (long.outcome.mean_s - begin)
    assert short.outcome.p_success >= 1.0 - 0.005


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the peak of one process alone is told by Linux")
def test_peak_memory_is_not_that_of_the_process_that_started_it():
    held = np.ones(40_000_000)
    script = "from benchmarks.tables.memory import peak_memory_mb; print(peak_memory_mb())"
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, check=True, capture_output=True, text=True)
    assert 0.0 < float(done.stdout) < held.nbytes / 2**20 < peak_memory_mb()


@pytest.mark.parametrize(
    ("run", "arguments", "told"),
    [
        (seeds.main, ["--seeds", "1"], "--seeds: '1' is not a whole number, 2 or more"),
        (seeds.main, ["--only", "0,x"], "--only: 'x' is not a whole number, 0 or more"),
        (seeds.main, ["--only", "99"], "--only: requests have the numbers 0 to "),
        (bench_promises.main, ["--requests", "0"], "--requests: '0' is not a whole number, 1 or more"),
        (bench_promises.main, ["--utilisation", "nan"], "--utilisation: 'nan' is not a number from 0 to 0.99"),
        (bench_gap.main, ["--days", "some"], "--days: 'some' is not a whole number, 1 or more"),
        (bench_aboard.main, ["--draws", "1"], "--draws: '1' is not a whole number, 2 or more"),
    ],
)
def test_a_number_that_a_benchmark_cannot_be_run_with_is_refused_at_once(monkeypatch, capsys, run, arguments, told):
    monkeypatch.setattr(sys, "argv", ["benchmark", *arguments])
    with pytest.raises(SystemExit) as ended:
        run()
    assert ended.value.code == 2
    assert told in capsys.readouterr().err
