"""What a laboratory states: its dates and limits, and mistakes in them."""

import re

import pytest

from tumblecal import InputError
from tumblecal.certificate.admin import read_admin


@pytest.mark.parametrize(
    ("dates", "faults"),
    [
        ({"begin": "25", "end": "21"}, ["performance.end: 2026-11-21 is before performance.begin 2026-11-25"]),
        ({"received": "29", "issued": "01"}, ["performance.begin: ", "issued: 2026-11-01 is before"]),
        ({"received": None, "issued": "21"}, []),
        ({"received": "20", "begin": "20", "end": "20", "issued": "20"}, []),
    ],
)
def test_dates_that_cannot_follow_each_other_are_refused(tmp_path, configs, dates, faults):
    text, path = (configs / "certificate_lab.toml").read_text(), tmp_path / "admin.toml"
    for key, day in dates.items():
        text = re.sub(rf"^{key} = .*", "" if day is None else f"{key} = 2026-11-{day}", text, flags=re.MULTILINE)
    path.write_text(text)
    if not faults:
        read_admin(path)
        return
    with pytest.raises(InputError) as error:
        read_admin(path)
    assert len(error.value.faults) == len(faults)
    for fault, words in zip(error.value.faults, faults, strict=True):
        key = words.partition(":")[0].rpartition(".")[2]
        line = next(number for number, own in enumerate(text.splitlines(), start=1) if own.startswith(f"{key} ="))
        assert fault.startswith(f"{path}:line {line}: {words}")


def test_mistakes_are_one_line(tumblecal, tmp_path, calibrated, admin, configs):
    text = admin.read_text()
    for change, words in (
        (text.replace('id = "ACC-2026-0117"', 'id = ""'), "id: "),
        (
            text.replace('country = "AT"', 'country = "Austria"'),
            "country: must be the country code of two capital letters",
        ),
        (text.replace("begin =", "begins ="), "performance.begins: unknown key; did you mean begin?"),
        (text.replace('"A-17"', '"B-2"'), "is of unit A-17"),
        (text.replace("traceability", "trace"), "traceability: is missing"),
        (text.replace("2026-11-21", "2026-13-21"), "not TOML"),
    ):
        path = tmp_path / "wrong.toml"
        path.write_text(change)
        outcome = tumblecal("certificate", calibrated, "--admin", path)
        assert outcome.code == 2 and outcome.lines and any(words in line for line in outcome.lines), outcome.lines
    limits = tmp_path / "limits.toml"
    for own, words in (
        ('dB = "1 mg"', "limits: dB: no such parameter"),
        ('bias = "1 mrad"', "their dimensions differ"),
        ('dK = "0"', "above 0"),
    ):
        limits.write_text(f'schema = "tumblecal.limits/1"\nsource = "s"\n[limits]\n{own}\n')
        outcome = tumblecal("certificate", calibrated, "--admin", admin, "--limits", limits)
        assert outcome.code == 2 and words in outcome.lines[0]
    outcome = tumblecal("certificate", tmp_path, "--admin", admin)
    assert outcome.code == 2 and "calibration.json: no such file" in outcome.lines[0]
    assert not (calibrated / "dcc.xml").exists()
