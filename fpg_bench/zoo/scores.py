"""How the zoo's agents and the scripts fare: one line per training seed and counterpart, committed."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from fpg_bench.evaluation.entry import Entry, player_entry
from fpg_bench.evaluation.evaluate import LINES, lines_of
from fpg_bench.evaluation.field import Field, load_field
from fpg_bench.evaluation.line import Line
from fpg_bench.evaluation.play import play
from fpg_bench.players.agent import load_agent
from fpg_bench.players.scripted import SCRIPTED
from fpg_bench.rows import RowFile
from fpg_bench.zoo.zoo import Zoo, ZooAgent, ZooView

Prints = dict[tuple[str, int | None], str]  # by name and training seed


def score_file(zoo: Zoo, view: ZooView) -> RowFile:
    """The file of a view's lines, only ever appended to."""
    return RowFile(zoo.scores(view) / LINES)


def member_entry(member: ZooAgent) -> Entry:
    """A shipped agent as an entry; raises UserError where it cannot be loaded."""
    return player_entry(load_agent(member.folder), member.algorithm, member.seed)


def read_zoo_lines(zoo: Zoo, view: ZooView, field: Field) -> list[Line]:
    """The lines of a view that speak of this field and of the agents as they are shipped."""
    return _current(lines_of(score_file(zoo, view)), _prints(zoo, view), field)


def add_missing_lines(
    zoo: Zoo, view: ZooView, progress: Callable[[str], None] = lambda name: None
) -> list[Line]:
    """Play a view's scripts and shipped agents against its fields where their lines are not there yet.

    Args:
        zoo: the zoo.
        view: one of its views.
        progress: called with the name of whoever is about to play.

    Returns:
        All lines of the view.
    """
    file, entries, found = score_file(zoo, view), _entries(zoo, view), []
    prints = _prints(zoo, view)
    with file.locked():
        for field in map(load_field, view.fields):
            known = _current(lines_of(file), prints, field)
            there = {(line.entry, line.training_seed, line.counterpart) for line in known}
            for entry in entries:
                missing = [
                    c for c in field.counterparts if (entry.name, entry.training_seed, c.name) not in there
                ]
                if missing:
                    seed = "" if entry.training_seed is None else f"/seed_{entry.training_seed}"
                    progress(f"{view.name}: {entry.name}{seed} against {field.name}")
                lines = [play(entry, field, counterpart) for counterpart in missing]
                file.append(line.row() for line in lines)
                known += lines
            found += known
    return found


def check_member(zoo: Zoo, member: ZooAgent) -> list[str]:
    """Play a shipped agent again, all rounds: what differs from its lines."""
    entry, found = member_entry(member), []
    for field in map(load_field, member.view.fields):
        lines = [play(entry, field, counterpart) for counterpart in field.counterparts]
        found += differences(lines, read_zoo_lines(zoo, member.view, field))
    return found


def differences(played: Iterable[Line], kept: Iterable[Line]) -> list[str]:
    """What differs between lines just played and the lines that are kept, counterpart by counterpart."""
    before = {(line.entry, line.training_seed, line.counterpart): line for line in kept}
    found = []
    for line in played:
        known = before.get((line.entry, line.training_seed, line.counterpart))
        if known is None:
            found.append(f"{line.field}, {line.counterpart}: no line")
        elif line.returns != known.returns:
            found.append(f"{line.field}, {line.counterpart}: other returns")
        elif line.rounds_sha256 != known.rounds_sha256:
            found.append(f"{line.field}, {line.counterpart}: the same returns, but other rounds")
    return found


def _entries(zoo: Zoo, view: ZooView) -> list[Entry]:
    """The scripts of a view's side and its shipped agents."""
    scripts = [player_entry(name) for name in SCRIPTED[view.side]]
    return scripts + [member_entry(member) for member in zoo.members(view.name) if member.shipped]


def _prints(zoo: Zoo, view: ZooView) -> Prints:
    """The fingerprints of a view's scripts and of its shipped agents, as ``agent.json`` says them."""
    prints: Prints = {(name, None): name[:16] for name in SCRIPTED[view.side]}
    shipped = [member for member in zoo.members(view.name) if member.shipped]
    return prints | {(m.algorithm, m.seed): str(m.about().get("policy_sha256"))[:16] for m in shipped}


def _current(lines: Iterable[Line], prints: Prints, field: Field) -> list[Line]:
    """Those lines of a field that are of just these players, the newest of each."""
    found = {}
    for line in lines:
        who = (line.entry, line.training_seed)
        if line.field_hash == field.hash[:16] and line.fingerprint == prints.get(who):
            found[*who, line.counterpart] = line
    return list(found.values())
