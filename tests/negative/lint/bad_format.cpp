// Must be rejected by clang-format: tools/lint fails if it is not. Not part of any build.
namespace lint {
int   badly_spaced( int a,int b ){ return a+b ; }
}
