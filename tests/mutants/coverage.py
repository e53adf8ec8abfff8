#!/usr/bin/env python3
"""Lines that a coverage build has run, by room.

usage: tests/mutants/coverage.py TREE [BUILD]

TREE/build/release (or BUILD) was configured with -O1 --coverage and its tests have been run. A line
counts once, and as run if any program ran it. gcov's own JSON is read: gcovr 5.2 gives up on a
static function whose name occurs in two files that are compiled together.
"""
import collections
import json
import os
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor

ROOMS = ('rt', 'perception', 'drivers', 'tasks', 'tools', 'config')


def objects_of(build):
    return [os.path.join(folder, name) for folder, _, names in os.walk(build)
            for name in names if name.endswith('.gcno')]


def lines_of(work):
    """Of one object: file -> line -> run. None: gcov said nothing that can be read."""
    tree, note = work
    said = subprocess.run(['gcov', '--json-format', '--stdout', note], capture_output=True,
                          cwd=os.path.dirname(note), check=False).stdout
    out = collections.defaultdict(dict)
    try:
        for document in map(json.loads, said.splitlines()):
            for f in document['files']:
                path = os.path.join(document['current_working_directory'], f['file'])
                path = os.path.relpath(os.path.normpath(path), tree)
                if path.split('/')[0] not in ROOMS or path.startswith('build/'):
                    continue
                for line in f['lines']:
                    n = line['line_number']
                    out[path][n] = out[path].get(n, False) or line['count'] != 0
    except ValueError:
        return None
    return dict(out)


def room_of(path):
    parts = path.split('/')
    return '/'.join(parts[:2]) if parts[0] == 'tools' else parts[0]


def main():
    if len(sys.argv) not in (2, 3) or sys.argv[1].startswith('-'):
        print(__doc__.strip())
        return 0 if '--help' in sys.argv else 2
    tree = os.path.realpath(sys.argv[1])
    notes = objects_of(sys.argv[2] if len(sys.argv) == 3 else tree + '/build/release')
    if not notes:
        print(f'{tree}: no object of a coverage build', file=sys.stderr)
        return 2
    run = collections.defaultdict(dict)
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for note, lines in zip(notes, pool.map(lines_of, [(tree, n) for n in notes], chunksize=4)):
            if lines is None:
                print(f'{note}: gcov can not read it', file=sys.stderr)
                return 1
            for path, by_line in lines.items():
                for n, was in by_line.items():
                    run[path][n] = run[path].get(n, False) or was
    total, hit = collections.Counter(), collections.Counter()
    for path, by_line in run.items():
        total[room_of(path)] += len(by_line)
        hit[room_of(path)] += sum(by_line.values())
    for room in sorted(total):
        print(f'{room:24} {hit[room]:6} of {total[room]:6}  {100 * hit[room] / total[room]:.1f} %')
    return 0


if __name__ == '__main__':
    sys.exit(main())
