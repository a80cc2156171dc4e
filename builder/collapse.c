#include "collapse.h"
