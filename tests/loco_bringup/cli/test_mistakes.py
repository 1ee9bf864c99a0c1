# SPDX-License-Identifier: Apache-2.0
"""Sixty mistakes that people make: each is one line that says what to do, and leaves nothing."""

import shlex

import pytest

from loco_bringup.cli import main as cli

BAG = "{root}/bags/surrogate_sine"
LINES = f"""
gapp
gap
gap nowhere --robot tigrillo
gap {BAG} --robot tigrilo
gap {BAG} --robot tigrillo --workers 0
gap {BAG} --robot tigrillo --effects coulomb_fricton
gap {BAG} --robot tigrillo --mapping nowhere.yaml
gap {BAG} --robot tigrillo --hold-out nowhere
gap check nowhere --robot tigrillo
gap check {BAG}
gap check {BAG} --robot tigrillo --workers 0
gap next nowhere
gap experiments tigrilo --out made
export-model tigrillo --to sdf
export-model nowhere --to mjcf
export-model tigrillo --to urdf --replay {BAG}
calibrate nowhere
calibrate {BAG} --seeds 0
calibrate {BAG} --generations many
run
run hyq_trott
run hyq_short --set gait.sped=0.3
run hyq_short --set gait.speed=fast
run hyq_short --set gait.speed
run hyq_short --seed -1
run hyq_short --duration -3
run hyq_short --duration long
run hyq_short --layout compose
run hyq_short --clock wall
run hyq_short --nodes hyqq
run nowhere.yaml
run servo_pendulum_sine --hardware nowhere.yaml --clock realtime
robot tigrilo
robot new nowhere.urdf --out made
list robot
schema experimnt
ros2 topic lst
hardware servo_pendulum nowhere.yaml
hardware simulate servo_pendulum nowhere.yaml
replay nowhere
info nowhere
info {{root}}/README.md
report nowhere
report {BAG}
compare {BAG}
compare nowhere elsewhere
view nowhere --save made.rrd
recover nowhere
export nowhere
export {BAG} --topics /nothing --out made
export {BAG} --format xls --out made
extract {BAG} /nothing --out made
extract nowhere --out made
study chapter9
study chapter8 --seeds 0
study chapter8 --workers 0
study chapter8 --points 0
optimise nothing
optimise hyq_trot --seeds 0
reproduce tigrilo
reproduce hyq --plan fast
reproduce msd --preset code
record --duration -1 --out made
mutants nothing
bench nothing
fuzz nothing
""".strip().splitlines()


def test_there_are_sixty():
    assert len(set(LINES)) >= 60


@pytest.mark.parametrize("line", LINES)
def test_a_mistake_is_one_line_and_leaves_nothing(line, repository, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as end:
        cli.main(shlex.split(line.format(root=repository)))
    said = capsys.readouterr()
    lines = [text for text in said.err.splitlines() if not text.startswith(("usage: ", "  "))]
    assert end.value.code == 2
    assert len(lines) == 1 and "Traceback" not in said.err
    left = [path.name for path in tmp_path.iterdir()]
    assert [name for name in left if not name.startswith(".coverage")] == []  # of the tests' own
