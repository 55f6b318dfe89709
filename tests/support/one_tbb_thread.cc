// Part of the daemon and of every test that are built with the thread sanitizer. Debian's TBB is
// not, so its hand-overs look like races, by the thousand, and hide real ones. With one thread
// there are none: what is left to be judged are our own threads.
#include <tbb/global_control.h>

namespace {

const tbb::global_control kOneThread(tbb::global_control::max_allowed_parallelism, 1);

}  // namespace
