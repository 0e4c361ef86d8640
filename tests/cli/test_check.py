import json

import cv2
import numpy as np
from tiny_capture import ball

from neural_strands.cli.main import main


def write(folder, images: int):
    """Three views side by side, a ball as the head, and the requested number of photographs."""
    poses = [[[1.0, 0, 0, 0.1 * k], [0, 1.0, 0, 0], [0, 0, 1.0, 1.0], [0, 0, 0, 1.0]] for k in range(3)]
    frames = [{"file_path": f"{k}.png", "transform_matrix": pose} for k, pose in enumerate(poses)]
    (folder / "transforms.json").write_text(json.dumps({"w": 32, "h": 32, "fl_x": 40.0, "frames": frames}))
    ball().export(folder / "head.obj")
    for k in range(images):
        noise = np.random.default_rng(k).integers(0, 255, (32, 32, 3), np.uint8)
        assert cv2.imwrite(str(folder / f"{k}.png"), noise)
    return folder


def test_the_table_says_what_to_do(tmp_path, capsys):
    assert main(["check", str(write(tmp_path, 3))]) == 0
    lines = capsys.readouterr().out.splitlines()
    row = next(k for k, line in enumerate(lines) if line.startswith("WARNING  viewpoints"))
    assert "3 views" in lines[row]
    assert lines[row + 1].strip().startswith("-> take")


def test_json_and_status_2_when_a_file_is_missing(tmp_path, capsys):
    assert main(["check", str(write(tmp_path, 1)), "--json"]) == 2
    output = capsys.readouterr()
    result = json.loads(output.out)
    assert result["worst"] == "error"
    assert any("1.png" in finding["message"] for finding in result["findings"])
    assert output.err.count("\n") == 1


def test_no_capture_is_one_sentence(tmp_path, capsys):
    assert main(["check", str(tmp_path)]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert "transforms.json" in output.err
