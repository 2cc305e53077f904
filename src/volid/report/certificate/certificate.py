"""The file of a certificate's data, and its public function."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from volid.exceptions import InputError
from volid.fitting.solution import Solution
from volid.io.basics.atomic import write_bytes
from volid.io.basics.targets import find_target
from volid.report.certificate.administration import Request, add_software, administrative_data
from volid.report.certificate.circumstances import add_conditions, add_instruments, add_methods, add_origin
from volid.report.certificate.element import DCC, SCHEMA, SCHEMA_INSTANCE, SI, add, add_texts
from volid.report.certificate.facts import facts_of
from volid.report.certificate.results import add_results
from volid.report.certificate.statements import add_statements
from volid.report.contents.contents import Contents, gather
from volid.report.language import Texts

HEAD = """\
<?xml version="1.0" encoding="UTF-8"?>
<!-- UNSIGNED RESULT FILE. This is data in the format of a digital calibration certificate, written by volid.
     It is not a calibration certificate: issuing and signing one is the act of a laboratory. -->
"""


def save_dcc(
    solution: Solution,
    path: str | Path,
    *,
    tool: Any = None,
    limits: str | Path | Mapping[str, Any] | None = None,
    data: Mapping[str, Any] | None = None,
    lang: str = "en",
    overwrite: bool = False,
) -> tuple[str, ...]:
    """Write a solution in the format of a digital calibration certificate (DCC 3.3.0, D-SI 2.2), as an unsigned result file.

    It is no certificate: issuing and signing one is the laboratory's act, and the file says so. It holds error motions (position,
    value with U or, from Monte Carlo samples, 95 % coverage interval, u), squareness, location errors, volumetric accuracy,
    methods, instruments, conditions, verdict, what is not determined, and conformity where limits were judged. Lengths are in
    metre, rotations in radian, positions of rotary axes in degree; every number reads back as the library's, digit by digit.
    Fixed texts are in English and German. Laboratory, customer, persons, machine numbers, instruments and dates come from the
    table `dcc` of the campaign's [conditions], or from `data` with the same keys, which the docstring of
    `volid.report.certificate.facts` shows. What nobody stated is named in a statement, and written as "not stated" where the
    schema demands it; nothing is invented.

    Args:
        solution: As `volid.fit` or `volid.load_solution` gives it.
        path: The file, such as "result.xml"; it appears completely or not at all.
        tool: Tool vector of the volumetric numbers, shape (3,) [mm]; None: the one of most readings.
        limits: Largest sizes allowed by symbol [mm, rad], as for `save_report`; conformity is stated by their decision rule.
        data: Facts that a certificate needs, which stand before those of [conditions].
        lang: Language that stands first, "en" or "de".
        overwrite: Whether an existing file may be replaced.

    Returns:
        Keys of the facts that nobody stated.

    Raises:
        InputError: a fact is not what is expected, or the numbers of the solution follow from a mistake in the campaign.
        OutputError: the file exists, or cannot be written.

    Source: DCC schema 3.3.0 and D-SI 2.2.1 of the PTB; ISO/IEC 17025:2017 7.8 for what a certificate has.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> missing = volid.save_dcc(solution, getfixture("tmp_path") / "result.xml", data={"country": "DE"})
    >>> missing[:3]
    ('identifier', 'begin', 'end')
    """
    find_target(path, overwrite)  # refused now, not after the work
    request = Request(solution, facts_of(solution.campaign, data), lang=Texts(lang).language)
    certificate_of(gather(solution, tool, limits=limits, expected=False), path, request, overwrite)
    return request.missing()


def certificate_of(contents: Contents, path: str | Path, request: Request, overwrite: bool = False) -> None:
    """Write the certificate data of the contents of a report. Raises as `save_dcc` does."""
    if contents.barrier:
        raise InputError(
            f"no result file is made of this solution: {contents.barrier}. Mend the campaign, and fit again"
        )
    tree = _tree(request, contents)
    write_bytes(path, HEAD.encode() + ET.tostring(tree, encoding="utf-8") + b"\n", overwrite)


def _tree(request: Request, contents: Contents) -> ET.Element:
    for prefix, space in (("dcc", DCC), ("si", SI), ("xsi", SCHEMA_INSTANCE)):
        ET.register_namespace(prefix, space)
    location = f"{DCC} {DCC}/v{SCHEMA}/dcc.xsd"
    root = ET.Element(
        f"{{{DCC}}}digitalCalibrationCertificate",
        {"schemaVersion": SCHEMA, f"{{{SCHEMA_INSTANCE}}}schemaLocation": location},
    )
    add_statements(administrative_data(root, request), request, contents.evaluation)
    part = add(add(root, "measurementResults"), "measurementResult")
    add_texts(part, "name", "result_name")
    add_methods(part, request)
    add_software(part, "usedSoftware", request.solution.provenance.get("volid", ""))
    add_instruments(part, request)
    add_conditions(part, request)
    add_results(part, contents)
    add_origin(part, request)
    ET.indent(root)
    return root
