"""Kernel, its modules and busybox for the guest: Debian's packages, unpacked into a cache, never installed.

The cache is $TELETACT_VM_CACHE, else teletact/vm in $XDG_CACHE_HOME or ~/.cache. It keeps what is needed of the
packages (about 30 MB), not the packages.
"""
import fcntl
import lzma
import os
import pathlib
import re
import shutil
import subprocess
import tarfile
import tempfile

META = "linux-image-6.12-rt-amd64"
FOLDERS = ("kernel/net/", "kernel/drivers/net/", "kernel/drivers/usb/", "kernel/drivers/hid/", "kernel/fs/configfs/",
           "kernel/lib/", "kernel/crypto/")


class NotHere(Exception):
    """Something that the rig needs and this machine does not give: one line that says what."""


def cache_folder():
    named = os.environ.get("TELETACT_VM_CACHE")
    base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return pathlib.Path(named or os.path.join(base, "teletact", "vm"))


def command(*words, cwd=None):
    try:
        done = subprocess.run(words, cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, timeout=300)
    except FileNotFoundError:
        raise NotHere(f"no {words[0]} on this machine") from None
    except subprocess.TimeoutExpired:
        raise NotHere(f"{words[0]} {words[1]}: no answer within 300 s") from None
    if done.returncode != 0:
        said = (done.stderr.strip() or done.stdout.strip()).splitlines()
        raise NotHere(f"{' '.join(words[:3])}: {said[-1] if said else 'failed'}")
    return done.stdout


def package_name():
    """The package of today: Debian removes older ones from its mirrors."""
    found = re.search(r"Depends: (linux-image-6\.12\S*-rt-amd64)$", command("apt-cache", "depends", META), re.M)
    if not found:
        raise NotHere(f"apt knows no package {META}: apt-get update?")
    return found.group(1)


def unpack(package, wanted, into):
    """Files of a .deb for which wanted(path) says under what name to keep them."""
    with subprocess.Popen(["dpkg-deb", "--fsys-tarfile", package], stdout=subprocess.PIPE) as pipe:
        with tarfile.open(fileobj=pipe.stdout, mode="r|") as tar:
            for member in tar:
                name = wanted(member.name) if member.isfile() else None
                if name:
                    target = into / name
                    target.parent.mkdir(parents=True, exist_ok=True)
                    with open(target, "wb") as out:
                        shutil.copyfileobj(tar.extractfile(member), out)


def of_kernel(path):
    if "/boot/vmlinuz-" in path:
        return "vmlinuz"
    inside = re.search(r"/lib/modules/[^/]+/(.*)", path)
    if not inside:
        return None
    name = inside.group(1)
    if name.startswith(FOLDERS) and name.endswith(".ko.xz"):
        return "modules/" + os.path.basename(name)
    return "modules.builtin" if name == "modules.builtin" else None


def fetch(name, folder):
    with tempfile.TemporaryDirectory(dir=folder.parent) as work:
        os.chmod(work, 0o755)
        command("apt-get", "download", name, "busybox-static", cwd=work)
        files = {p.name.split("_")[0]: p for p in pathlib.Path(work).glob("*.deb")}
        made = pathlib.Path(work) / "made"
        made.mkdir()
        unpack(files[name], of_kernel, made)
        unpack(files["busybox-static"], lambda p: "busybox" if p.endswith("bin/busybox") else None, made)
        for part in ("vmlinuz", "modules.builtin", "busybox"):
            if not (made / part).exists():
                raise NotHere(f"{name}: it has no {part}")
        os.chmod(made / "busybox", 0o755)
        made.rename(folder)


def get():
    """The folder with vmlinuz, modules/, modules.builtin and busybox. Raises NotHere."""
    cache = cache_folder()
    cache.mkdir(parents=True, exist_ok=True)
    with open(cache / "lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        old = sorted(p for p in cache.glob("linux-image-*") if (p / "vmlinuz").exists())
        try:
            name = package_name()
            if not (cache / name).exists():
                fetch(name, cache / name)
            return cache / name
        except NotHere:
            if old:  # what was fetched once is enough
                return old[-1]
            raise


def plain(name):
    return name.replace("-", "_")


def load_order(folder, names):
    """[(name, bytes)] of the modules and what they need, in the order to load them; what is built in is left out."""
    files = {plain(p.name[: -len(".ko.xz")]): p for p in (folder / "modules").glob("*.ko.xz")}
    builtin = {plain(os.path.basename(line)[: -len(".ko")])
               for line in (folder / "modules.builtin").read_text().split()}
    order, seen = [], set()

    def visit(name):
        name = plain(name)
        if name in seen or name in builtin:
            return
        seen.add(name)
        if name not in files:
            raise NotHere(f"the kernel package has no module {name}")
        content = lzma.decompress(files[name].read_bytes())
        depends = re.search(rb"\0depends=([^\0]*)\0", content)
        for needed in (depends.group(1).decode().split(",") if depends else []):
            if needed:
                visit(needed)
        order.append((name, content))

    for name in names:
        visit(name)
    return order
