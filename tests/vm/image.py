"""The guest's file system: an initramfs (cpio, newc) of busybox, programs with the libraries they are linked to, modules
and the cases."""
import os
import pathlib
import re
import stat
import subprocess


class Archive:
    def __init__(self):
        self.parts, self.seen, self.number = [], set(), 0

    def _entry(self, name, mode, content=b""):
        self.number += 1
        encoded = name.encode() + b"\0"
        fields = (self.number, mode, 0, 0, 1, 0, len(content), 0, 0, 0, 0, len(encoded), 0)
        head = b"070701" + b"".join(b"%08X" % f for f in fields)
        self.parts.append(head + encoded + b"\0" * (-(len(head) + len(encoded)) % 4))
        self.parts.append(content + b"\0" * (-len(content) % 4))

    def folder(self, name):
        if name in ("", "/") or name in self.seen:
            return
        self.folder(os.path.dirname(name))
        self.seen.add(name)
        self._entry(name.lstrip("/"), stat.S_IFDIR | 0o755)

    def file(self, name, content, mode=0o644):
        if name in self.seen:
            return
        self.folder(os.path.dirname(name))
        self.seen.add(name)
        self._entry(name.lstrip("/"), stat.S_IFREG | mode, content)

    def bytes(self):
        self._entry("TRAILER!!!", 0)
        return b"".join(self.parts)


def libraries(program):
    """Paths of the shared libraries of a program, the loader with them."""
    said = subprocess.run(["ldd", program], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True).stdout
    if "not found" in said:
        raise RuntimeError(f"{program}: {said.strip()}")
    return re.findall(r"(?:=> |^\s+)(/\S+) \(0x", said, re.M)


def build(kernel_folder, modules, programs, texts):
    """`programs`: {path in the guest: path here}; `texts`: {path in the guest: (text, mode)}."""
    archive = Archive()
    for name in ("/proc", "/sys", "/dev", "/tmp", "/bb", "/run", "/var/run/netns"):
        archive.folder(name)
    archive.file("/bin/busybox", (pathlib.Path(kernel_folder) / "busybox").read_bytes(), 0o755)
    for inside, here in programs.items():
        archive.file(inside, pathlib.Path(here).read_bytes(), 0o755)
        for library in libraries(here):
            archive.file(library, pathlib.Path(library).read_bytes(), 0o755)
    for i, (name, content) in enumerate(modules):
        archive.file(f"/modules/{i:02}-{name}.ko", content)
    for inside, (text, mode) in texts.items():
        archive.file(inside, text.encode(), mode)
    return archive.bytes()
