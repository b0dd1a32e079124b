"""Write the tables of numbers in `docs/explanation/model.md` from the printed parameter set.

Run after changing that set:  python docs/make_model_page.py
"""

from __future__ import annotations

from pathlib import Path

import model

PAGE = Path(__file__).parent / "explanation" / "model.md"
START, END = "<!-- tables by docs/make_model_page.py -->", "<!-- end of tables -->"


def tables() -> str:
    """Return the tables of bodies and contacts as Markdown."""
    action = model.load_action("hirschkorn2004")
    lines = [
        "| body | m (g) | I (kg m²) | x, y of the centre of mass (mm) | A of the joint (N m) |",
        "|---|---:|---:|---:|---:|",
    ]
    for body in model.BODIES:
        x, y = (1e3 * action[f"{body}.center_of_mass.{axis}"] for axis in "xy")
        numbers = f"{1e3 * action[f'{body}.mass']:g} | {action[f'{body}.inertia']:.3g} | {x:g}, {y:g}"
        lines.append(f"| {body} | {numbers} | {action[f'{body}.joint_friction.A']:g} |")
    names = ("normal.a", "normal.b", "normal.c", "normal.D", "friction.A", "friction.B1", "friction.B2")
    lines += [
        "",
        "| no. | contact | a (N/m³) | b (N/m²) | c (N/m) | D (s/m) | A | B₁ | B₂ |",
        "|---:|---" + "|---:" * 7 + "|",
    ]
    for number in range(1, 14):
        path = f"contact{number:02d}"
        values = " | ".join(f"{action[f'{path}.{name}']:.4g}" for name in names)
        lines.append(f"| {number} | {action.structure[f'{path}.description']} | {values} |")
    return "\n".join(lines) + "\n"


def page() -> str:
    """Return the page with its tables written anew."""
    text = PAGE.read_text(encoding="utf-8")
    head, _, rest = text.partition(START)
    return f"{head}{START}\n\n{tables()}\n{END}{rest.partition(END)[2]}"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
