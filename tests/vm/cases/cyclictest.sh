# How late a bare thread wakes in this guest: what start times are held against.
cyclictest -m -p 90 -i 1000 -l $((CYCLICTEST_SECONDS * 1000)) -q > /tmp/cyclictest
cat /tmp/cyclictest
cyclictest_max_us=$(sed -n 's/.*Max: *\([0-9]*\).*/\1/p' /tmp/cyclictest | head -1)
echo "figure vm.cyclictest_max_us $cyclictest_max_us us"
