#include "prepare.h"
