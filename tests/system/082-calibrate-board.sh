#!/bin/bash
# pyrovox calibrate board: sheets written, what is wrong said, nothing left behind or written over.
name=082
. "$(dirname "$0")/lib.sh"
cd "$dir" || exit 1
sheets() {
    run "$pyrovox" calibrate board charuco:6x8:30mm:22mm --two-sided --page A4 --out board.pdf
    says 0 'charuco:6x8:0.03:0.022:5X5_100:two-sided' '35 corners on each face' 'measure the ruler' || return 1
    [ "$(head -c 4 board.pdf)" = %PDF ] && grep -aq '/Count 2' board.pdf || return 1
    run "$pyrovox" calibrate board aprilgrid:5x5:0.02:0.006:two-sided -o grid.svg
    says 0 '100 corners' && grep -q '<svg' grid.svg && grep -q '<svg' grid-back.svg && ! cmp -s grid.svg grid-back.svg
}
symmetric_is_said() {
    run "$pyrovox" calibrate board chessboard:8x6:0.025 -o chess.pdf
    says 0 'same after half a turn'
}
refused() {
    echo kept > kept.pdf
    run "$pyrovox" calibrate board charuco:8x11:0.03 -o kept.pdf
    says 1 'side of a marker is missing' || return 1
    run "$pyrovox" calibrate board charuco:8x11:0.03:0.022 --page A4 -o kept.pdf
    says 1 'take a larger page' || return 1
    run "$pyrovox" calibrate board charuco:8x11:0.03:0.022 -o kept.png
    says 1 '.pdf or .svg' || return 1
    run "$pyrovox" calibrate board charuco:8x11:0.03:0.022 -o nowhere/board.pdf
    says 1 'nowhere/board.pdf' || return 1
    [ "$(cat kept.pdf)" = kept ] && [ ! -e kept.png ]
}
usage() {
    run "$pyrovox" calibrate
    says 2 'board' || return 1
    run "$pyrovox" calibrate bord
    says 2 "no step 'bord'" || return 1
    run "$pyrovox" calibrate board charuco:8x11:0.03:0.022
    says 2 'where to?' || return 1
    run "$pyrovox" calibrate board --help
    says 0 'two-sided' 'measure the ruler' 'Examples' || return 1
    run "$pyrovox" calibrate --help
    says 0 'board'
}
check sheets sheets
check symmetric-is-said symmetric_is_said
check refused refused
check usage usage
exit $rc
