# Sourced by cross-build and qemu-check: Debian packages unpacked into a folder of their own, nothing installed.

# unpack_debs FOLDER PACKAGE...: prints why and returns 1 when they cannot be had.
unpack_debs() {
    local folder=$1 as_root
    shift
    [ ! -e "$folder/complete" ] || return 0
    command -v apt-get >/dev/null && command -v dpkg-deb >/dev/null || { echo 'not a Debian system'; return 1; }
    if ! apt-cache show "$1" >/dev/null 2>&1; then
        as_root=$([ "$(id -u)" = 0 ] || echo sudo -n)
        $as_root apt-get update -qq >/dev/null 2>&1
    fi
    rm -rf "$folder" && mkdir -p "$folder/debs"
    # apt as root would hand the download to a user who may not write here.
    (cd "$folder/debs" && apt-get -qq -o APT::Sandbox::User=root download "$@" >/dev/null 2>&1) ||
        { echo "Debian packages $* cannot be fetched"; return 1; }
    local deb
    for deb in "$folder"/debs/*.deb; do
        dpkg-deb -x "$deb" "$folder" || return 1
    done
    rm -rf "$folder/debs"
    touch "$folder/complete"
}

# depends_of PACKAGE PATTERN: those of its direct dependencies that match.
depends_of() {
    apt-cache depends "$1" 2>/dev/null | sed -n "s/^ *Depends: \($2\)\$/\1/p" | sort -u
}
