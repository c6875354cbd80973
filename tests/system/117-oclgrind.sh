#!/bin/bash
# offline: The kernels' tests on Oclgrind, which interprets them: no access out of bounds, no data race, no wrong call.
name=117
. "$(dirname "$0")/lib.sh"
simulator=/usr/lib/oclgrind/liboclgrind-rt-icd.so
[ -e $simulator ] || { echo "FAIL $name: $simulator is not there: apt install oclgrind"; exit 1; }
export OCL_ICD_VENDORS=$simulator T_OPENCL=Oclgrind OCLGRIND_DATA_RACES=1 OCLGRIND_CHECK_API=1 OCLGRIND_LOG=$dir/reports
export OCLGRIND_GLOBAL_MEM_SIZE=2147483648

faulty() { # a kernel with one fault of each kind: both are seen
    cat > "$dir/faulty.cl" << 'C'
kernel void faulty(global int *a) { a[get_global_id(0) / 2] = get_global_id(0); a[1000 + get_global_id(0)] = 1; }
C
    printf '%s\n' faulty.cl faulty '4 1 1' '4 1 1' '<size=16 fill=0>' > "$dir/faulty.sim"
    (cd "$dir" && env -u OCLGRIND_LOG oclgrind-kernel --data-races --log seen faulty.sim) > "$dir/said" 2>&1
    grep -q 'Invalid write' "$dir/seen" && grep -q 'data race' "$dir/seen" || { cat "$dir/said"; return 1; }
}
check a_fault_would_be_seen faulty

# Cases that go every way through the kernels on little data: Oclgrind is some thousand times slower.
cases() { # program
    case $1 in
    test_cl_device) echo lists_what_there_is,buffers_there_and_back,sums_are_those_of_a_serial_sum ;;
    test_cl_products) echo windows_of_2x2,a_part_that_is_empty ;;
    test_cl_system) echo trilinear_of_three_channels,a_part_of_the_matrix ;;
    test_cl_ops_passes) echo passes_are_those_of_the_processor ;;
    test_cl_ops_problem) echo loads_weights_and_residuals_are_those_of_the_processor,the_sum_of_channels_is_that_of_the_processor,corrections_of_cameras_are_those_of_the_processor ;;
    test_cl_ops_solves) echo starts_are_those_of_the_processor ;; # whole solves have the same kernels
    test_cl_photo) echo equals_the_processors ;;
    test_cl_unpack) echo equals_cap_convert ;;
    test_cl_alloc | test_cl_cache | test_cl_faults | test_cl_rates | test_cl_waits) ;; # these are about the host
    # whole frame sets take hours, by the kernels of the others
    test_cl_check | test_cl_fallback | test_cl_frame | test_cl_frame_bits | test_cl_raw) ;;
    *) return 1 ;;
    esac
}
clean() { # program
    local n
    T_ONLY=$(cases "${1##*/}") || { echo "$1: say above which of its cases run here"; return 1; }
    [ -n "$T_ONLY" ] || return 0
    n=$(tr ',' '\n' <<< "$T_ONLY" | wc -l)
    export T_ONLY
    : > "$dir/reports"
    "$1" > "$dir/said" 2>&1 && [ "$(grep -c '^PASS' "$dir/said")" = "$n" ] && [ ! -s "$dir/reports" ] ||
        { tail -n 40 "$dir/said"; head -n 40 "$dir/reports"; return 1; }
}
programs=0
for program in "$b"/tests/{unit,check}/test_cl_*; do
    [[ -x $program && $program != *.* ]] || continue
    check "${program##*/}" clean "$program"; programs=$((programs + 1))
done
check there_are_some [ $programs -ge 12 ]
exit $rc
