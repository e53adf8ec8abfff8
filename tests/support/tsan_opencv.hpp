// OpenCV's imgcodecs sets up GDAL at its first use, and GDAL takes two of its own locks in either
// order on one thread. Not our code; everything else stays reported. Include in one file a program.
#pragma once

#if defined(__SANITIZE_THREAD__)
extern "C" const char* __tsan_default_suppressions();
extern "C" const char* __tsan_default_suppressions() { return "deadlock:libgdal\n"; }
#endif
