#include "canonical.h"
