import{i as o}from"./chunk-F7OM52AD.js";var r=o([]);export{r as a};
