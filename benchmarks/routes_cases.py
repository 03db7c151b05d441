"""The cases of each route; a bound for each is computed where it is made."""

from __future__ import annotations

from collections.abc import Callable

from routes_common import Case
from routes_points import closed_forms, poses, triangulations
from routes_scenes import line_cases, scene_cases, selfcalib_cases, wand_cases

CASES: dict[str, Callable[[], list[Case]]] = {
    "pose": poses,
    "triangulate": triangulations,
    "zhang": lambda: closed_forms("zhang"),
    "dlt": lambda: closed_forms("dlt"),
    "mdlt": lambda: closed_forms("mdlt"),
    "central": lambda: closed_forms("central"),
    "dlt12": lambda: closed_forms("dlt12"),
    "dlt16": lambda: closed_forms("dlt16"),
    "tsai": lambda: closed_forms("tsai"),
    "fitzgibbon": lambda: closed_forms("fitzgibbon"),
    "claus": lambda: closed_forms("claus"),
    "lines": line_cases,
    "scene": scene_cases,
    "selfcalib": selfcalib_cases,
    "wand": wand_cases,
}
