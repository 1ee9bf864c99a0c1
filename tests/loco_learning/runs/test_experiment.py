# SPDX-License-Identifier: Apache-2.0
"""Reading experiments: all that ship are sound, all mistakes get one clear message."""

import pickle

import pytest

from loco_control.exceptions import LocoError, MissingFileError, NameUnknownError, ParameterError
from loco_control.gait.oscillators import CpgParams
from loco_control.params import to_dict
from loco_learning.plain import flat
from loco_learning.runs import experiment
from loco_learning.runs.experiment import Experiment, from_values, load, merge, names, override
from loco_learning.runs.gait_file import Gait
from loco_sim.plant.model import Model


def write(folder, text, name="mine"):
    path = folder / f"{name}.yaml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("name", names())
def test_every_experiment_reads_describes_itself_and_survives_a_round_trip(name):
    made = load(name)
    assert made.name == name
    assert len(made.description) > 20
    assert made.ticks > 0
    assert from_values(to_dict(made)) == made


def test_the_ones_that_documents_name_exist():
    wanted = {"hyq_trot_open", "hyq_trot_reflex", "hyq_trot_long", "hyq_author_scaling",
              "hyq_short", "chapter8_pse", "chapter8_rse"}  # fmt: skip
    assert wanted <= set(names())


def test_chapter_8_estimators_differ_in_nothing_but_the_estimator():
    pse, rse = (to_dict(load(f"chapter8_{kind}")) for kind in ("pse", "rse"))
    differing = {key for key in pse if pse[key] != rse[key]}
    assert differing == {"name", "description", "stance"}
    assert pse["criterion"] == {"fall": True, "phase_slip": 1.0, "freeze": 0.2, "nrmse": 0.3}
    delay = load("chapter8_pse").effects[0]
    test_start = sum(pse["learner"][phase] for phase in ("stand", "train", "closing"))
    assert delay["start"] == test_start + 10.0
    assert rse["stance"]["estimator_start"] == test_start - pse["learner"]["closing"]


@pytest.mark.parametrize("name", ["hyq_short", "tigrillo_bound"])
def test_an_experiment_names_its_engine_whether_asked_or_not(name):
    assert to_dict(load(name))["sim"]["engine"] == load(name).sim_params.engine
    assert load(name, {"sim.engine": "mujoco"}).sim_params.engine == "mujoco"
    with pytest.raises(NameUnknownError, match="engine.*drake.*available: mujoco, pybullet"):
        load(name, {"sim.engine": "drake"})


def test_duration_is_that_of_the_phases_unless_given():
    made = load("hyq_short")
    assert made.ticks == round(made.learner.duration * 250)
    assert override(made, {"duration": 2.0}).ticks == 500


def test_overrides_reach_any_depth_and_are_checked():
    made = load("hyq_short", {"learner.memory": 30, "gait.speed": 0.1, "seed": 4})
    assert (made.learner.memory, made.gait.speed, made.seed) == (30, 0.1, 4)
    assert made.learner.train == load("hyq_short").learner.train
    with pytest.raises(NameUnknownError, match="memori.*did you mean 'memory'"):
        load("hyq_short", {"learner.memori": 30})


def test_a_file_may_extend_another_file_or_an_experiment(tmp_path):
    write(tmp_path, "extends: hyq_trot_reflex\ngait: {speed: 0.1}\nseed: 3\n", "base")
    made = load(write(tmp_path, "extends: base.yaml\ngait: {step_height: 0.05}\n"))
    assert (made.gait.speed, made.gait.step_height, made.seed) == (0.1, 0.05, 3)
    assert made.gait.frequency == load("hyq_trot_reflex").gait.frequency
    assert (made.name, made.description) == ("mine", "")


def test_lists_are_replaced_and_mappings_merged():
    base = {"a": {"b": 1, "c": 2}, "d": [1, 2]}
    assert merge(base, {"a": {"c": 3}, "d": [4]}) == {"a": {"b": 1, "c": 3}, "d": [4]}
    assert base["a"]["c"] == 2


def test_numbers_in_scientific_notation_are_numbers(tmp_path):
    made = load(write(tmp_path, "learner: {regularisation: 1e-4}\n"))
    assert made.learner.regularisation == 1e-4


@pytest.mark.parametrize(
    ("text", "kind", "message"),
    [
        ("gait: {speed: 0.1", ParameterError, r"mine.yaml, line 1"),
        ("seed: 1\nname: a: b\n", ParameterError, r"mine.yaml, line 2"),
        ("- 1\n", ParameterError, "must hold a mapping"),
        ("", ParameterError, "must hold a mapping"),
        ("seed: 1\nseed: 2\n", ParameterError, r"line 2, is not YAML: 'seed' is given twice"),
        ("gait: {spede: 0.1}\n", NameUnknownError, "spede.*did you mean 'speed'"),
        ("gaits: {}\n", NameUnknownError, "gaits.*did you mean 'gait'"),
        (
            "target: {frequency: 1.0}\ngait: {}\n",
            ParameterError,
            "a target of oscillators, or a gait",
        ),
        ("target: {frequency: 1.0}\nstance: {}\n", ParameterError, "not both"),
        ("robot: tigrillo\ngait: {}\n", ParameterError, "'tigrillo' lists no legs"),
        ("kind: joints\n", NameUnknownError, "joints"),
        ("gait: fast\n", ParameterError, "mine.gait must be a mapping"),
        ("learner: {memory: many}\n", ParameterError, "mine.learner.memory must be a number"),
        ("learner: {memory: 0}\n", ParameterError, r"memory must be in \[1, 1000\]"),
        ("learner: {enabled: 1}\n", ParameterError, "enabled must be true or false"),
        ("robot: anymal\n", NameUnknownError, "anymal.*available: .*hyq"),
        ("effects: {name: push}\n", ParameterError, "effects must be a list"),
        ("effects: [push]\n", ParameterError, r"effects\[0\] must be a mapping"),
        ("effects: [{name: pusch}]\n", NameUnknownError, "no effect named 'pusch'"),
        ("effects: [{name: command_delay, delay: -1}]\n", ParameterError, "delay must be in"),
        ("extends: 3\n", ParameterError, "extends must be the name"),
        ("extends: nothing\n", NameUnknownError, "no experiment named 'nothing'"),
        ("extends: gone.yaml\n", MissingFileError, "gone.yaml"),
        ("extends: mine.yaml\n", ParameterError, "extends itself"),
    ],
)
def test_a_mistake_in_a_file_gets_one_clear_message(tmp_path, text, kind, message):
    with pytest.raises(kind, match=message) as caught:
        load(write(tmp_path, text))
    assert isinstance(caught.value, LocoError)
    assert "\n" not in str(caught.value)


def test_unknown_names_and_missing_files():
    with pytest.raises(NameUnknownError, match="did you mean 'hyq_short'"):
        load("hyq_shrot")
    with pytest.raises(MissingFileError, match="nowhere.yaml"):
        load("nowhere.yaml")


def test_bytes_that_are_no_text_are_told_with_their_line(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ParameterError, match="line 1: not UTF-8 text, byte 0xff"):
        load(path)


def test_effects_are_checked_in_code_too():
    with pytest.raises(ParameterError, match="effects must be a list"):
        Experiment(effects={"name": "push"})
    made = Experiment(effects=[{"name": "command_delay", "delay": 0.01}])
    assert made.replace(seed=1).effects == made.effects
    assert experiment.override(made, {"seed": 1}).effects == made.effects


OLD_GAINS = {
    "swing_kp": [150.0, 250.0, 150.0],
    "swing_kd": [10.0, 8.0, 6.0],
    "stance_kp": [150.0, 150.0, 100.0],
    "stance_kd": [10.0, 8.0, 6.0],
}


def test_gains_of_older_experiments_become_drives_of_the_robot():
    made = from_values({"impedance": OLD_GAINS})
    for joint, drive in made.plant.drives.items():
        k = ("haa", "hfe", "kfe").index(joint.split("_")[1])
        assert (drive.kp, drive.kd) == (OLD_GAINS["stance_kp"][k], OLD_GAINS["stance_kd"][k])
        assert drive.swing == (OLD_GAINS["swing_kp"][k], OLD_GAINS["swing_kd"][k])
    assert len(made.plant.drives) == 12
    assert made.plant.drives == load("chapter8_pse").plant.drives
    assert from_values(to_dict(made)) == made


def test_gains_of_the_command_line_count_more_than_those_of_the_file():
    knee = "drives.*_kfe_joint.swing_kp"
    made = load("chapter8_pse", {"impedance.swing_kp": [150.0, 250.0, 999.0]})
    assert made.overrides[knee] == 999.0
    assert override(made, {"impedance.swing_kp": [1.0, 2.0, 3.0]}).overrides[knee] == 3.0
    assert override(made, {f"overrides.{knee}": 5.0}).overrides[knee] == 5.0


@pytest.mark.parametrize(
    ("gains", "kind", "message"),
    [
        ({"swing_kp": [1.0]}, ParameterError, "impedance.swing_kp must be a list of 3 numbers"),
        ({"kp": [1.0, 1.0, 1.0]}, NameUnknownError, "parameter in impedance"),
        (3, ParameterError, "impedance must be a mapping, got 3"),
        ({"swing_kp": [1.0, "a", 1.0]}, ParameterError, "swing_kp must be a number"),
        ({"swing_kd": [1.0, -7.0, 1.0]}, ParameterError, r"swing_kd must be in \[-1, inf\]"),
    ],
)
def test_gains_that_are_none_get_one_clear_message(gains, kind, message):
    with pytest.raises(kind, match=message):
        from_values({"impedance": gains})


def test_overrides_of_the_robot_are_checked():
    with pytest.raises(NameUnknownError, match="kff"):
        load("hyq_short", {"overrides.drives.*_kff_joint.kp": 1.0})
    with pytest.raises(ParameterError, match="overrides must be a mapping"):
        from_values({"overrides": [1]})
    heavy = load("hyq_short", {"overrides.masses.base_link": 90.0})
    assert heavy.plant.urdf != load("hyq_short").plant.urdf


# ---- what an experiment settles, with a robot of joints


@pytest.mark.parametrize("name", names())
def test_an_experiment_travels_to_other_processes(name):
    made = load(name)
    assert pickle.loads(pickle.dumps(made)) == made


def test_the_nodes_follow_from_what_the_experiment_says():
    assert load("hyq_short").node_set == Experiment().node_set == "hyq"
    assert load("tigrillo_walk").node_set == Experiment(robot="tigrillo").node_set == "joint"
    assert load("msd_20").node_set == "msd"
    both = from_values({"robot": "hyq", "target": {"amplitude": [0.1]}})
    assert (both.node_set, both.gait, both.trunk) == ("joint", None, None)
    assert len(both.outputs) == 12


@pytest.mark.parametrize("name", ["hyq_short", "tigrillo_walk", "msd_20"])
def test_files_of_earlier_versions_named_their_kind(name):
    made = load(name)
    kind = made.node_set
    assert from_values({"kind": kind, **to_dict(made)}) == made
    if kind == "hyq":  # and wrote down every value of the plant
        assert from_values({**to_dict(made), "sim": to_dict(made.sim_params)}).plant.name == "hyq"


def test_control_rate_is_the_robots_unless_given():
    assert load("tigrillo_hold").control_rate == load("tigrillo_hold").plant.control_rate
    assert load("tigrillo_hold", {"control_rate": 50.0}).dt == 0.02


def test_overrides_reach_the_robot_nested_or_dotted():
    dotted = load("tigrillo_hold", {"overrides": {"springs.lf_kfe_joint.stiffness": 300.0}})
    nested = load("tigrillo_hold", {"overrides.springs.lf_kfe_joint.stiffness": 300.0})
    assert dotted == nested
    assert dotted.plant.springs["lf_kfe_joint"].stiffness == 300.0
    assert flat({"a": {"b": 1, "c": {"d": 2}}, "e.f": 3}) == {"a.b": 1, "a.c.d": 2, "e.f": 3}


def test_sim_is_the_robots_with_changes_on_top():
    experiment = load("tigrillo_hold", {"sim.friction": 0.25})
    plain = load("tigrillo_hold")
    assert experiment.sim_params == plain.sim_params.replace(friction=0.25)
    assert plain.sim_params == plain.plant.sim


def test_a_model_dissolves_into_robot_overrides_and_effects(tmp_path):
    model = Model(
        "tigrillo",
        {"springs.*_kfe_joint.stiffness": 400.0, "masses.front_body": 0.7},
        [{"name": "command_delay", "delay": 0.02}],
    )
    model.save(tmp_path / "model.yaml")
    changes = {
        "robot": str(tmp_path / "model.yaml"),
        "overrides": {"masses.front_body": 0.6},
        "effects": [{"name": "command_delay", "delay": 0.01}],
    }
    experiment = load("tigrillo_hold", changes)
    assert experiment.robot == "tigrillo"
    assert experiment.plant.springs["rh_kfe_joint"].stiffness == 400.0
    assert experiment.overrides["masses.front_body"] == 0.6  # the experiment's wins
    assert [effect["delay"] for effect in experiment.effects] == [0.02, 0.01]
    assert override(experiment, {"seed": 3}).effects == experiment.effects  # not twice


def test_a_gait_can_be_the_target(tmp_path):
    found = CpgParams(amplitude=(0.1, 0.2, 0.3, 0.4), phase=(0.0, 0.5, 0.5, 0.0))
    path = str(tmp_path / "gait.yaml")
    Gait("mine", "tigrillo", found, {}, 0.1, 1.5, 15.0, 0, 1).save(path)
    assert load("tigrillo_hold", {"target": path}).target == found
    changed = load("tigrillo_walk", {"target": {"gait": path}, "target.amplitude": [0.25]})
    phase = (0.0, 0.5, 0.5, 0.0)
    assert changed.target == found.replace(amplitude=(0.25,), phase=phase)
    with pytest.raises(MissingFileError, match="nowhere"):
        load("tigrillo_hold", {"target": "nowhere.yaml"})


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"robot": "tigrilo"}, NameUnknownError, "tigrillo"),
        ({"robot": "nowhere/robot.yaml"}, MissingFileError, "nowhere"),
        ({"overrides": {"springs.*.stifness": 1.0}}, NameUnknownError, "stiffness"),
        ({"overrides": {"springs.*_kfe_joint.stiffness": -1.0}}, ParameterError, "-1"),
        ({"overrides": [1]}, ParameterError, "mapping"),
        ({"sim": {"frction": 0.1}}, NameUnknownError, "friction"),
        ({"effects": {"name": "push"}}, ParameterError, "list"),
        ({"effects": [{"name": "pussh"}]}, NameUnknownError, "push"),
        ({"target.phase": [0.0, 0.5]}, ParameterError, "4 driven joints"),
        ({"target.amplitude": [9.0]}, ParameterError, "amplitude"),
        ({"gait": {}}, ParameterError, "lists no legs"),
    ],
)
def test_what_does_not_fit_a_robot_is_refused(changes, error, message):
    with pytest.raises(error, match=message):
        load("tigrillo_hold", changes)


def test_an_entry_of_a_list_is_set_by_its_number():
    base = load("chapter8_pse", {"effects.0.delay": 0.02})
    assert base.effects[0] == {"name": "command_delay", "delay": 0.02, "start": 161.0}
    assert override(base, {"effects.0.delay": 0.03}).effects[0]["delay"] == 0.03
    with pytest.raises(ParameterError, match=r"effects.3 names no entry: effects has 1"):
        override(base, {"effects.3.delay": 0.03})
