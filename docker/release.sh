#!/bin/sh
# Makes the artefacts of a release from the program that the launcher has built: a Debian package, a tarball of the same
# files, the sources, and their checksums. The same commit gives the same bytes on the same machine.
#
#   ./proact release [DIR]     into DIR, by default build/release
set -eu

repository=$(cd "$(dirname "$0")/.." && pwd)
program=$1
out=${2:-$repository/build/release}

fail() {
    echo "release: $*" >&2
    exit 1
}

# --- Version ---------------------------------------------------------------------------------------------

version=$(sed -n 's/^version = "\([^"]*\)".*/\1/p' "$repository/Cargo.toml" | head -n 1)
cited=$(sed -n 's/^version: *//p' "$repository/CITATION.cff")
[ "$cited" = "$version" ] || fail "CITATION.cff says version $cited, Cargo.toml $version"
commit=$(git -C "$repository" rev-parse HEAD) || fail "the sources are in no git repository, so no commit can be named"
changed=$(git -C "$repository" status --porcelain --untracked-files=no)
[ -z "$changed" ] || fail "files are changed and not committed: a release has a commit"
if [ "$(git -C "$repository" tag --points-at HEAD --list "v$version")" ]; then
    grep -q "^## $version" "$repository/CHANGELOG.md" || fail "HEAD is v$version, and CHANGELOG.md has no section \"## $version\""
else
    # Sorts before the release that it comes before.
    # With ~ before dev, as Debian has versions before a release.
    version=$(printf %s "$version" | tr - '~')~git$(git -C "$repository" show -s --format=%cd --date=format:%Y%m%d).$(git -C "$repository" rev-parse --short=8 HEAD)
fi
said=$("$program" --version | head -n 1)
case $said in
*"$(git -C "$repository" rev-parse --short=12 HEAD))") ;;
*) fail "the program says \"$said\", expected the commit $commit" ;;
esac
SOURCE_DATE_EPOCH=$(git -C "$repository" show -s --format=%ct)
export SOURCE_DATE_EPOCH
architecture=$(dpkg --print-architecture)

# --- Files -----------------------------------------------------------------------------------------------

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
# The folders of a package and of a tarball are read by everybody.
umask 022
chmod 755 "$work"
usr=$work/deb/usr
doc=$usr/share/doc/proact
install -D -m 755 "$program" "$usr/bin/proact"
strip --strip-unneeded "$usr/bin/proact"

"$program" man "$usr/share/man/man1" 2>/dev/null
gzip -9n "$usr"/share/man/man1/*.1
mkdir -p "$usr/share/bash-completion/completions" "$usr/share/zsh/vendor-completions" "$usr/share/fish/vendor_completions.d"
"$program" completions bash >"$usr/share/bash-completion/completions/proact"
"$program" completions zsh >"$usr/share/zsh/vendor-completions/_proact"
"$program" completions fish >"$usr/share/fish/vendor_completions.d/proact.fish"

# The program has its arms and tasks inside; these are for a lab to copy and change. Those of tasks/shipped need another name first.
data=$usr/share/proact
copy_committed() { # PATH INTO: a folder as it was committed, without what tests left in it
    mkdir -p "$2"
    git -C "$repository" archive HEAD:"$1" | tar -xf - -C "$2"
}
copy_committed ros1_ws/src/proact_description/arms "$data/arms"
copy_committed docs/methods "$data/methods"
copy_committed docs/decoders "$data/decoders"
copy_committed docs/intent_models "$data/intent_models"
copy_committed docs/tasks "$data/tasks"
copy_committed examples "$data/examples"
copy_committed rust/tasks/data "$data/tasks/shipped"
rm "$data/tasks/shipped/bbt_norms.toml"

# What roslaunch, rospack, rosmsg and rostopic look for, under the prefix where they look: launch files, arm descriptions,
# message packages and their Python classes. The link in proact_nodes is the executable: ROS without Debian's patches finds
# it there as well, where /usr/share is in ROS_PACKAGE_PATH.
suggested="www-browser, r-cran-lme4, r-cran-ordinal"
if "$program" doctor 2>/dev/null | grep '^ok *feature ros ' >/dev/null; then
    copy_committed ros1_ws/src "$work/ros"
    for package in proact_bringup proact_description proact_moveit_config proact_nodes; do
        rm "$work/ros/$package/CMakeLists.txt"
        cp -R "$work/ros/$package" "$usr/share/"
    done
    rm -r "$usr/share/proact_description/arms"
    ln -s ../proact/arms "$usr/share/proact_description/arms"
    ln -s ../../bin/proact "$usr/share/proact_nodes/proact"
    /usr/bin/python3 "$repository/ros1_ws/python_messages.py" "$work/ros" "$work/messages" || fail "the Python classes of the messages"
    cp -R "$work/messages/share/." "$usr/share/"
    mkdir -p "$usr/lib/python3/dist-packages"
    cp -R "$work/messages/lib/." "$usr/lib/python3/dist-packages/"
    suggested="$suggested, ros-core, python3-roslaunch, python3-rostopic, ros-robot-state-publisher, rviz"
else
    echo "release: the program was built without ROS 1, so that the packages have no nodes" >&2
fi

mkdir -p "$doc"
gzip -9nc "$repository/CHANGELOG.md" >"$doc/changelog.gz"
cp "$repository/README.md" "$repository/THIRD_PARTY.md" "$repository/CITATION.cff" "$doc/"
{
    echo "ProACT, under MIT or Apache-2.0, as you choose. What it is linked with and made of is in THIRD_PARTY.md."
    echo
    cat "$repository/LICENSE-MIT"
    echo
    cat "$repository/LICENSE-APACHE"
} >"$doc/copyright"
find "$usr" -type f ! -path "$usr/bin/*" -exec chmod 644 {} +
find "$usr" -type d -exec chmod 755 {} +

# --- Debian package --------------------------------------------------------------------------------------

# dpkg-shlibdeps reads who the package is from a source tree's debian/control.
mkdir -p "$work/source/debian" "$work/deb/DEBIAN"
printf 'Source: proact\n\nPackage: proact\nArchitecture: any\n' >"$work/source/debian/control"
libraries=$(cd "$work/source" && dpkg-shlibdeps -O -e"$usr/bin/proact" | sed -n 's/^shlibs:Depends=//p')
[ -n "$libraries" ] || fail "dpkg-shlibdeps found no library that the program needs"
cat >"$work/deb/DEBIAN/control" <<CONTROL
Package: proact
Version: $version
Architecture: $architecture
Maintainer: The ProACT contributors <contributors@proact.invalid>
Installed-Size: $(du -sk "$usr" | cut -f1)
Depends: $libraries, fonts-dejavu-core
Suggests: $suggested
Section: science
Priority: optional
Description: open testbed for intelligent prosthetic arms
 A person with muscle signals, gaze and a tracked shoulder, or a simulated one,
 drives a virtual arm of seven joints with a hand through clinical tasks, with
 control methods from direct joint control to gaze and task context.
 .
 "proact demo" shows a trial in the browser. No ROS and no hardware is needed.
CONTROL
if [ -d "$usr/lib/python3" ]; then
    # As Debian's own packages of Python modules do: compiled where Python is, and nothing of it stays behind.
    cat >"$work/deb/DEBIAN/postinst" <<'POSTINST'
#!/bin/sh
set -e
if [ "$1" = configure ] && command -v py3compile >/dev/null; then py3compile -p proact; fi
POSTINST
    cat >"$work/deb/DEBIAN/prerm" <<'PRERM'
#!/bin/sh
set -e
if command -v py3clean >/dev/null; then py3clean -p proact; fi
PRERM
    chmod 755 "$work/deb/DEBIAN/postinst" "$work/deb/DEBIAN/prerm"
fi
(cd "$work/deb" && find usr -type f -print0 | LC_ALL=C sort -z | xargs -0 md5sum >DEBIAN/md5sums)
find "$work/deb" -exec touch --no-dereference --date="@$SOURCE_DATE_EPOCH" {} +

rm -rf "$out"
mkdir -p "$out"
out=$(cd "$out" && pwd)
dpkg-deb --root-owner-group -Zxz --build "$work/deb" "$out/proact_${version}_$architecture.deb" >/dev/null

# --- Tarballs --------------------------------------------------------------------------------------------

make_tarball() { # FILE FOLDER: the folder of $work as a tarball
    tar -C "$work" --sort=name --owner=0 --group=0 --numeric-owner --mtime="@$SOURCE_DATE_EPOCH" -cf - "$2" | gzip -9n >"$1"
}

name=proact-$version-$(uname -m)-linux-gnu
mv "$usr" "$work/$name"
cp "$repository/LICENSE-MIT" "$repository/LICENSE-APACHE" "$work/$name/"
echo "$libraries, fonts-dejavu-core" | tr ',' '\n' | sed 's/^ *//' >"$work/$name/NEEDS"
make_tarball "$out/$name.tar.gz" "$name"
git -C "$repository" archive --prefix="proact-$version/" HEAD | gzip -9n >"$out/proact-$version-source.tar.gz"
(cd "$out" && sha256sum -- * >SHA256SUMS)
cat "$out/SHA256SUMS"
echo "release: $version is in $out" >&2
